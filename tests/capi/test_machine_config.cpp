// A machine file through the program and through the C interface: the same events, and no key that
// reaches the one and not the other.
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "check.hpp"
#include "every_key.hpp"
#include "servosense/capi/machine_config.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/monitors/torque_band_file.hpp"

namespace {

using namespace servosense;
using namespace every_key;

const char* const kMachine = R"(
[machine]
name = bed
sample_rate_hz = 8000
[spindle]
torque_constant_Nm_per_A = 0.5
inertia_kg_m2 = 0.0048
coulomb_friction_Nm = 0.1
encoder_counts_per_rev = 1048576
[axis.x]
lead_m = 0.016
equivalent_mass_kg = 227
coulomb_friction_N = 94
torque_constant_Nm_per_A = 0.8
encoder_counts_per_rev = 1048576
[axis.y]
lead_m = 0.016
equivalent_mass_kg = 260
force_constant_N_per_A = 300
encoder_counts_per_rev = 1048576
[axis.z]
lead_m = 0.016
equivalent_mass_kg = 380
moving_mass_kg = 175
vertical = yes
torque_constant_Nm_per_A = 0.8
encoder_counts_per_rev = 1048576
[controller.x]
current_limit_A = 60
[observer.x]
disturbance_cutoff_rad_s = 500
[tool]
teeth = 4
diameter_m = 0.016
[monitor.chatter]
chatter_threshold_Nm2 = 0.5
window_revolutions = 12
[monitor.collision]
threshold_N_per_s = 14580
cutting_threshold_x_N_per_s = 60000
cutting_torque_Nm = 0.8
[monitor.ar-breakage]
noise_Nm = 0.02
[monitor.tooth-breakage]
noise_Nm = 0.02
sample_noise_Nm = 0.05
noise_N = 4
sample_noise_N = 12
[monitor.drill-fracture]
threshold_N = 4000
[monitor.wear]
cutting_thrust_N = 120
thrust_limit_N = 800
taught_thrust_N = 350
taught_torque_Nm = 1
[monitor.torque-band]
reference = band.csv
[effect.x.stribeck-friction]
extra_static_N = 25
stribeck_velocity_m_per_s = 0.004
[effect.x.torque-ripple]
order = 1, 6
amplitude_N = 8, 3.5
phase_rad = 0.2, -1.1
)";

MachineFile machine(const std::string& more = "") {
  static const std::string folder = [] {
    const auto path = std::filesystem::temp_directory_path() / "servosense_machine_config";
    std::filesystem::create_directories(path);
    TorqueBandReference band;
    band.spacing = 0.01;
    for (int i = 0; i < 500; ++i) band.points.push_back({2.0 + 0.001 * i, 1.5, 40});
    CHECK(write_torque_band((path / "band.csv").string(), band, {"test"}));
    std::ofstream(path / "predicted.csv")
        << "line,t_s,spindle.torque_Nm,low_Nm,high_Nm\n1,2,0,0,0\n2,4,3,2.8,3.2\n3,5,0,0,0\n";
    band.over_path = true;
    CHECK(write_torque_band((path / "path.csv").string(), band, {"test"}));
    return path.string();
  }();
  auto file = MachineFile::parse(kMachine + more, folder + "/m.ini");
  if (!file) check::fail(__FILE__, __LINE__) << file.error().sentence << '\n';
  return *file;
}

struct Told {
  int monitor, channel, state;
  double t_s;
};

/// A cut of four teeth from 0.3 s on, of which one breaks at 1.2 s; chatter from 2.2 s; x runs into
/// something in the air at 3.2 s, a table, that turns at 3 rad/s, at 3.4 s; z falls silent at 3.5
/// s.
template <typename Hear>
void record(Hear hear) {
  constexpr double kPeriod = 125e-6;
  for (std::int64_t n = 0; n < 32000; ++n) {
    const double t = kPeriod * static_cast<double>(n);
    const double angle = 314 * t;
    const bool cuts = t > 0.3 && t < 2.8;
    double torque = 0.1;
    for (int tooth = 0; cuts && tooth < 4; ++tooth) {
      const double at = std::remainder(angle - tooth * kTwoPi / 4, kTwoPi);
      const double share = tooth == 2 && t > 1.2 ? 0.2 : tooth == 3 && t > 1.2 ? 1.8 : 1;
      if (at > 0 && at < 1.2) torque += 4 * share * std::sin(at / 1.2 * kTwoPi / 2);
    }
    if (cuts && t > 2.2) torque += 3 * std::sin(kTwoPi * 771.3 * t);
    ServoSample<double, kAllAxes> s;
    s.t_ns = n * 125000;
    s.spindle.counts = static_cast<std::int64_t>(angle / kTwoPi * 1048576);
    s.spindle.effort = torque / 0.5;
    const double per_A = 0.8 / m_per_rad(0.016);
    const double x = t > 3 ? 0.03 + 0.3 * (t - 3) : 0.01 * t;
    s.axis[0].counts = static_cast<std::int64_t>(x / 0.016 * 1048576);
    s.axis[0].effort = (94 + (t > 3.2 ? std::min(4000.0, 4e5 * (t - 3.2)) : 0)) / per_A;
    s.axis[2].effort = 175 * 9.80665 / per_A;
    s.axis[3].counts = static_cast<std::int64_t>(3 * t / kTwoPi * 1048576);
    s.axis[3].effort = (5 + (t > 3.4 ? std::min(200.0, 2e4 * (t - 3.4)) : 0)) / 40;
    if (t > 3.5 && t < 3.7) s.axis[2].motion_quality = s.axis[2].effort_quality = Quality::missing;
    hear(s, t);
  }
}

std::vector<Told> by_program(const MachineFile& file, const StackSignals& signals) {
  auto plan = plan_stack(file, signals);
  if (!plan) {
    check::fail(__FILE__, __LINE__) << plan.error().sentence << '\n';
    return {};
  }
  auto stack = std::make_unique<HostStack>();
  prepare(*stack, *plan);
  std::vector<Told> told;
  record([&](const ServoSample<double, kAllAxes>& s, double t) {
    for (const StateChange<double>& c : stack->process(s))
      told.push_back(
          {static_cast<int>(c.monitor), static_cast<int>(c.channel), static_cast<int>(c.state), t});
  });
  return told;
}

void copy_drive(const RawDriveSample<double>& from, servosense_drive_sample& to) {
  to.counts = from.counts;
  to.motion = from.motion;
  to.effort = static_cast<float>(from.effort);
  to.motion_flags = static_cast<std::uint16_t>(from.motion_quality);
  to.effort_flags = static_cast<std::uint16_t>(from.effort_quality);
}

std::vector<Told> by_c(const MachineFile& file, const StackSignals& signals) {
  auto made = machine_config(file, signals);
  if (!made) {
    check::fail(__FILE__, __LINE__) << made.error().sentence << '\n';
    return {};
  }
  struct alignas(16) Storage {
    std::array<unsigned char, SERVOSENSE_STORAGE_BYTES> bytes;
  };
  auto storage = std::make_unique<Storage>();
  servosense_stack* stack = nullptr;
  const char* where = "";
  const char* const fault =
      servosense_init(storage->bytes.data(), storage->bytes.size(), &made->config, &stack, &where);
  if (fault != nullptr) {
    check::fail(__FILE__, __LINE__) << where << ": " << fault << '\n';
    return {};
  }
  std::vector<Told> told;
  record([&](const ServoSample<double, kAllAxes>& s, double t) {
    servosense_sample in{};
    in.t_ns = s.t_ns;
    copy_drive(s.spindle, in.spindle);
    for (std::size_t i = 0; i < SERVOSENSE_AXES; ++i) copy_drive(s.axis[i], in.axis[i]);
    std::array<servosense_event, SERVOSENSE_MAX_EVENTS> events;
    const int n = servosense_process(stack, &in, events.data(), SERVOSENSE_MAX_EVENTS);
    for (int k = 0; k < n; ++k) {
      const servosense_event& e = events[static_cast<std::size_t>(k)];
      told.push_back({e.monitor, e.channel, e.state, t});
    }
  });
  return told;
}

bool raised(const std::vector<Told>& told, int monitor, int state) {
  return std::any_of(told.begin(), told.end(),
                     [&](const Told& t) { return t.monitor == monitor && t.state == state; });
}

void same_events(const std::string& more, bool tells_breakage) {
  const MachineFile file = machine(more);
  auto signals = signals_of_file(file);
  CHECK(signals);
  const std::vector<Told> program = by_program(file, *signals), c = by_c(file, *signals);
  for (std::size_t i = 0; i < std::max(program.size(), c.size()); ++i) {
    const auto show = [&](const std::vector<Told>& told) {
      if (i >= told.size()) return std::string("-");
      const Told& t = told[i];
      return std::string(servosense_monitor_name(t.monitor)) + " " +
             servosense_channel_name(t.channel) + " " + servosense_state_name(t.state) + " " +
             std::to_string(t.t_s);
    };
    if (i >= program.size() || i >= c.size() || program[i].state != c[i].state ||
        program[i].monitor != c[i].monitor || std::abs(program[i].t_s - c[i].t_s) > 1e-3)
      std::printf("    %-50s %s\n", show(program).c_str(), show(c).c_str());
  }
  CHECK(program.size() == c.size());
  double apart = 0;
  for (std::size_t i = 0; i < std::min(program.size(), c.size()); ++i) {
    CHECK(program[i].monitor == c[i].monitor && program[i].channel == c[i].channel &&
          program[i].state == c[i].state);
    apart = std::max(apart, std::abs(program[i].t_s - c[i].t_s));
  }
  check::figure("events", static_cast<double>(program.size()));
  check::figure("furthest apart", 1e3 * apart, "ms");
  // Two samples: a level that is just reached in double may be missed in float.
  CHECK(apart <= 250e-6);
  CHECK(raised(c, SERVOSENSE_CHATTER, SERVOSENSE_ALARM));
  CHECK(raised(c, SERVOSENSE_COLLISION, SERVOSENSE_ALARM));
  CHECK(raised(c, SERVOSENSE_SIGNAL, SERVOSENSE_SIGNAL_FAULT));
  if (tells_breakage) CHECK(raised(c, SERVOSENSE_TOOTH_BREAKAGE, SERVOSENSE_ALARM));
  const bool table = std::any_of(c.begin(), c.end(), [](const Told& t) {
    return t.monitor == SERVOSENSE_COLLISION && t.channel == SERVOSENSE_A &&
           t.state == SERVOSENSE_ALARM && t.t_s > 3.4 && t.t_s < 3.41;
  });
  CHECK(table == (more.find("[axis.a]") != std::string::npos));
}

/// The C header for the file with this key at this value; a sentence where it is refused.
std::string header_with(const Line& l, const std::string& value) {
  std::string more;
  if (l.section.starts_with("effect.")) {  // with the rest of its section
    for (const Line& other : all_keys())
      if (other.section == l.section && other.key != l.key)
        more += other.key + " = " + other.value + "\n";
    if (machine().has_section(l.section)) more.clear();
    if (!more.empty()) more = "[" + l.section + "]\n" + more;
  }
  MachineFile file = machine(more);
  if (l.section == "observer.spindle" || l.key == "cutoff_rad_s") {
    file.set("observer.spindle", "disturbance_cutoff_rad_s", "2500");
    file.set("observer.x", "disturbance_cutoff_rad_s", "500");
  }
  if (l.section == "monitor.torque-band" && l.key.ends_with("_m"))
    file.set("monitor.torque-band", "reference", "path.csv");
  if (l.section == "monitor.torque-band" && l.key.starts_with("tolerance_"))
    file.set("monitor.torque-band", "reference", "predicted.csv");
  if (any_of(l.key, {"noise_N", "sample_noise_N"}))
    file.set("monitor.tooth-breakage", "signal", "force");
  if (l.section == "monitor.cutting-coefficients" || l.key == "specific_force_ratio") {
    file.set("monitor.cutting-coefficients", "enabled", true);
    file.set("tool", "tangential_coefficient_N_per_m2", 1.9e9);
    for (const auto& [name, number] :
         {std::pair{"feed_per_tooth_m", 6e-5}, std::pair{"axial_depth_m", 0.003},
          std::pair{"radial_immersion_m", 0.008}, std::pair{"spindle_speed_rpm", 6000.0}})
      file.set("cut", name, number);
  }
  file.set(l.section, l.key, value);
  auto signals = signals_of_file(file);
  if (!signals) return signals.error().sentence;
  // A key that is gone from what the file says of itself may not hide in comments of the header.
  auto made = machine_config(file, *signals);
  if (!made) return made.error().sentence;
  made->monitors.clear();
  return c_header(*made, "machine", "machine");
}

void every_key_arrives() {
  int arrived = 0, host = 0;
  for (const Line& l : all_keys()) {
    const MachineKey* const key = find_machine_key(l.section, l.key);
    if (key == nullptr) {
      CHECK(key != nullptr);
      continue;
    }
    // A name; shown by a_band_arrives(); what decides whether a monitor runs, and is then done.
    if (l.key == "name" || l.key == "reference" || l.key.starts_with("learned_")) continue;
    const bool differs = header_with(l, l.value) != header_with(l, changed(*key, l.value));
    if (differs == is_host_only(l))
      std::printf("    [%s] %s: %s\n", l.section.c_str(), l.key.c_str(),
                  differs ? "reaches C but is listed as of hosts alone" : "does not reach C");
    CHECK(differs != is_host_only(l));
    ++(differs ? arrived : host);
  }
  check::figure("keys that reach the C configuration", arrived);
  check::figure("keys for hosts alone", host);
  CHECK(arrived > 100);
}

void a_band_arrives() {
  const MachineFile file = machine();
  auto made = machine_config(file, *signals_of_file(file));
  CHECK(made);
  if (!made) return;
  const servosense_torque_band& band = made->config.torque_band;
  CHECK(band.enabled == 1 && band.reference_count == 500 && band.reference != nullptr);
  CHECK_NEAR(static_cast<double>(band.reference[499].torque_Nm), 2.499, 1e-6);
  CHECK(made->config.wear.taught_thrust_N == 350);
  CHECK(made->config.axis[0].effect_count == 2 && made->config.chatter.window_revolutions == 12);
}

/// A field that a block gains changes its size: it wants a line in config_fields.hpp or
/// config_translation.hpp, and then the number here.
void no_field_is_forgotten() {
  struct Known {
    const char* name;
    std::size_t bytes, known;
  };
  const Known blocks[] = {
      {"SignalHealthConfig", sizeof(SignalHealthConfig), 40},
      {"ChatterConfig", sizeof(ChatterConfig), 136},
      {"CollisionConfig", sizeof(CollisionConfig), 184},  // standing_m_s: hosts alone
      {"CutDetectorConfig", sizeof(CutDetectorConfig), 64},
      {"ArBreakageConfig", sizeof(ArBreakageConfig), 112},
      {"ToothBreakageConfig", sizeof(ToothBreakageConfig), 128},
      {"DrillFractureConfig", sizeof(DrillFractureConfig), 88},
      {"WearConfig", sizeof(WearConfig), 280},
      {"CuttingCoefficientsConfig", sizeof(CuttingCoefficientsConfig), 312},
      {"TorqueBandConfig", sizeof(TorqueBandConfig), 168},  // tooth_count: hosts alone
      {"DriveModelView", sizeof(DriveModelView), 96},
      {"DisturbanceObserverView", sizeof(DisturbanceObserverView), 136},
      {"DriveInputConfig", sizeof(DriveInputConfig), 96},
      {"ToolMonitorsConfig", sizeof(ToolMonitorsConfig), 792},
  };
  for (const Known& b : blocks) {
    if (b.bytes != b.known)
      std::printf("    %s has %zu bytes for %zu: is the new field in src/capi?\n", b.name, b.bytes,
                  b.known);
    CHECK(b.bytes == b.known);
  }
  check::figure("MonitorStackConfig", sizeof(MonitorStackConfig), "bytes");
  CHECK(sizeof(MonitorStackConfig) < 4096);
}

}  // namespace

int main() {
  same_events("", true);
  same_events(
      "[axis.a]\ninertia_kg_m2 = 2\ncoulomb_friction_Nm = 5\ntorque_constant_Nm_per_A = 40\n"
      "encoder_counts_per_rev = 1048576\n[monitor.collision.a]\nthreshold_Nm_per_s = 2000\n",
      true);
  same_events("[monitor.signal]\ntolerated_share = 0.02\n", true);
  every_key_arrives();
  a_band_arrives();
  no_field_is_forgotten();
  return check::done();
}
