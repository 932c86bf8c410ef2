// The machine files of examples/ can be read and used, and the bundled recording shows through the
// observer the same cut that its raw numbers show.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <string>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/observer/machine_config.hpp"

using namespace servosense;
namespace fs = std::filesystem;

namespace {

MachineFile machine(const std::string& path) {
  auto file = MachineFile::read(path);
  if (!file) {
    check::fail(__FILE__, __LINE__) << file.error().sentence << '\n';
    std::exit(1);
  }
  return *file;
}

void every_machine_file_serves_its_drives() {
  int files = 0;
  for (const auto& entry : fs::directory_iterator("examples/machines")) {
    if (entry.path().extension() != ".ini") continue;
    ++files;
    const MachineFile file = machine(entry.path().string());
    CHECK(file.text("machine", "name").has_value());
    StackSignals signals;
    signals.sample_period_s =
        1 / file.number("machine", "sample_rate_hz").value_or(1000);  // of its traces, if unstated
    // Motion without a scale of its own, so that only the drive's own numbers are in question.
    if (file.has_section("spindle"))
      signals.spindle =
          DriveSignal{MotionKind::velocity, file.has("spindle", "torque_constant_Nm_per_A")
                                                ? EffortKind::current_A
                                                : EffortKind::torque_Nm};
    for (std::size_t i = 0; i < kAxes; ++i) {
      const std::string axis = "axis." + std::string(name_of(axis_channel(i)));
      if (!file.has_section(axis)) continue;
      const bool current =
          file.has(axis, "torque_constant_Nm_per_A") || file.has(axis, "force_constant_N_per_A");
      signals.axis[i] =
          DriveSignal{MotionKind::velocity, current ? EffortKind::current_A : EffortKind::force_N};
    }
    const auto plan = plan_stack(file, signals);
    if (!plan) check::fail(__FILE__, __LINE__) << plan.error().sentence << '\n';
    CHECK(plan.has_value());
  }
  check::figure("machine files", files);
  CHECK(files >= 9);
}

// The rotary equivalents of Koike's axes, worked out from his tables apart from this project's
// code: R^2 M and R C with R = lead / 2 pi.
void koike_axes_have_his_rotary_equivalents() {
  const MachineFile file = machine("examples/machines/koike_tc_s2c.ini");
  struct Row {
    Channel axis;
    double inertia_kg_m2, coulomb_Nm;
  };
  for (const Row& row : {Row{Channel::x, 1.4720e-3, 0.23937}, Row{Channel::y, 2.1075e-3, 0.38452},
                         Row{Channel::z, 2.4641e-3, 0.61115}}) {
    const auto axis = axis_config(file, row.axis);
    CHECK(axis.has_value());
    if (!axis) continue;
    const double r = axis->lead_m / kTwoPi;
    CHECK_NEAR(r * r * axis->equivalent_mass_kg, row.inertia_kg_m2, 5e-8);  // last digit given
    CHECK_NEAR(r * axis->coulomb_friction_N, row.coulomb_Nm, 5e-6);
  }
  const auto z = axis_config(file, Channel::z);
  CHECK(z && z->vertical && z->moving_mass_kg == 175);
}

// At one speed friction cancels, and the torque of the cut is the difference of the currents. The
// means over the seconds 88 (tool 11 cuts) and 92 (air), both at 3000 rpm, were taken from the
// publisher's counts: 537.7 and 385.6, 344 of which are the unit.
void the_bundled_recording_shows_its_cut() {
  const std::string path = "tests/data/turnmill/part_excerpt.csv";
  auto reader = TraceReader::open(path);
  CHECK(reader.has_value());
  if (!reader) return;
  CHECK(reader->meta("units").value_or("").find("ratio") != std::string::npos);
  auto source = SampleSource::open(std::move(*reader), path);
  CHECK(source.has_value());
  if (!source) return;
  CHECK_NEAR(source->sample_period_s(), 1e-3, 1e-9);
  CHECK(source->spindle().has_value());
  if (!source->spindle()) return;
  StackSignals signals;
  signals.sample_period_s = source->sample_period_s();
  signals.spindle = source->spindle()->signal;
  const auto plan = plan_stack(machine("examples/machines/turnmill.ini"), signals);
  CHECK(plan.has_value());
  if (!plan) return;
  CHECK(std::any_of(plan->monitors.begin(), plan->monitors.end(),
                    [](const auto& m) { return m.monitor == MonitorId::chatter && m.runs; }));
  const auto stack = std::make_unique<HostStack>();
  stack->configure(plan->config);
  double cut = 0, air = 0;
  int cut_samples = 0, air_samples = 0;
  ServoSample<double> sample;
  for (;;) {
    const auto more = source->next(sample);
    CHECK(more.has_value());
    if (!more || !*more) break;
    stack->process(sample);
    const double t = seconds_from(sample.t_ns);
    if (t >= 88 && t < 89) cut += stack->spindle().estimate, ++cut_samples;
    if (t >= 92 && t < 93) air += stack->spindle().estimate, ++air_samples;
  }
  CHECK(cut_samples == 1000 && air_samples == 1000);
  cut /= cut_samples;
  air /= air_samples;
  check::figure("torque of the cut, multiples of the air running torque", cut - air);
  // Speed stays within 6 rpm in both seconds: 0.6 rad/s over a second at 0.018 is 0.011.
  CHECK_NEAR(cut - air, (537.7 - 385.6) / 344, 0.012);
  // In the air what the counts say is left, less the friction that was learned from other air.
  const MachineFile learned = machine("examples/machines/turnmill.ini");
  const double friction =
      learned.number("spindle", "coulomb_friction_Nm").value_or(0) +
      learned.number("spindle", "viscous_friction_Nm_s_per_rad").value_or(0) * rad_s_from_rpm(3000);
  CHECK_NEAR(air, 385.6 / 344 - friction, 0.012);
  // That air ran at 0.945 at this speed; noise alone lets the fit miss it by 0.05.
  CHECK_NEAR(friction, 0.945, 0.05);
  CHECK(source->health().gaps == 0);
}

}  // namespace

int main() {
  every_machine_file_serves_its_drives();
  koike_axes_have_his_rotary_equivalents();
  the_bundled_recording_shows_its_cut();
  return check::done();
}
