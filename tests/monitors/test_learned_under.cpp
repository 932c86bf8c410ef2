// A threshold is used under the conditions that it was learned under, or not at all.
#include <algorithm>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/monitors/learned_under.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace {

using namespace servosense;

const char* const kMachine = R"([machine]
name = bed
[spindle]
torque_constant_Nm_per_A = 0.5
inertia_kg_m2 = 0.0048
encoder_counts_per_rev = 131072
[axis.x]
lead_m = 0.016
equivalent_mass_kg = 227
force_constant_N_per_A = 200
encoder_counts_per_rev = 1048576
[axis.y]
lead_m = 0.016
equivalent_mass_kg = 227
force_constant_N_per_A = 200
encoder_counts_per_rev = 1048576
[tool]
teeth = 4
[monitor.chatter]
chatter_threshold_Nm2 = 0.02
[monitor.ar-breakage]
noise_Nm = 0.01
[monitor.collision]
threshold_x_N_per_s = 14580
threshold_y_N_per_s = 14580
cutting_threshold_x_N_per_s = 99999
cutting_torque_Nm = 0.1
)";

StackSignals signals(double rate_hz, bool y = true) {
  StackSignals s;
  s.sample_period_s = 1 / rate_hz;
  s.spindle = DriveSignal{};
  s.axis[0] = DriveSignal{};
  if (y) s.axis[1] = DriveSignal{};
  return s;
}

StackPlan planned(const MachineFile& file, const StackSignals& on) {
  auto plan = plan_stack(file, on);
  if (!plan) check::fail(__FILE__, __LINE__) << plan.error().sentence << '\n';
  return plan ? *plan : StackPlan{};
}

MonitorAvailability of(const StackPlan& plan, MonitorId id, Channel channel) {
  for (const MonitorAvailability& m : plan.monitors)
    if (m.monitor == id && m.channel == channel) return m;
  return {};
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// The file as a learning command leaves it.
MachineFile learned(double rate_hz = 8000) {
  MachineFile file = *MachineFile::parse(kMachine, "m.ini");
  const StackPlan plan = planned(file, signals(rate_hz));
  for (const Channel drive : {Channel::spindle, Channel::x, Channel::y})
    CHECK(write_learned_under(file, plan.config, drive).empty());
  // What is written can be read.
  auto again = MachineFile::parse(file.text(), "m.ini");
  if (!again) check::fail(__FILE__, __LINE__) << again.error().sentence << '\n';
  return file;
}

MachineFile changed(const char* section, const char* key, double value) {
  MachineFile file = learned();
  file.set(section, key, value);
  return file;
}

struct Watcher {
  MonitorId monitor;
  Channel channel;
};
constexpr Watcher kChatter{MonitorId::chatter, Channel::spindle};
constexpr Watcher kBreakage{MonitorId::ar_breakage, Channel::tool};
constexpr Watcher kX{MonitorId::collision, Channel::x};
constexpr Watcher kY{MonitorId::collision, Channel::y};
const std::vector<Watcher> kAll = {kChatter, kBreakage, kX, kY};

void check_stopped(const char* name, const StackPlan& plan, const std::vector<Watcher>& stopped,
                   const std::string& says) {
  for (const Watcher& w : kAll) {
    const MonitorAvailability m = of(plan, w.monitor, w.channel);
    const bool stops = std::any_of(stopped.begin(), stopped.end(), [&](const Watcher& s) {
      return s.monitor == w.monitor && s.channel == w.channel;
    });
    const std::string what = std::string(name) + ": " + name_of(w.monitor) + " on " +
                             std::string(name_of(w.channel)) + ": " + m.reason;
    check::that(m.runs != stops, what.c_str(), __FILE__, __LINE__);
    if (!stops) continue;
    CHECK_TEXT(m.obstacle, "other conditions");
    check::that(contains(m.reason, says) && contains(m.reason, "identify idle"), what.c_str(),
                __FILE__, __LINE__);
  }
}

void what_differs_stops() {
  check_stopped("as learned", planned(learned(), signals(8000)), {}, "");
  // A clock that is 1 % off is the same rate.
  check_stopped("another clock", planned(learned(), signals(8080)), {}, "");
  check_stopped("rate", planned(learned(), signals(4000)), kAll, "sample rate [Hz] 8000, now 4000");
  check_stopped("teeth", planned(changed("tool", "teeth", 6), signals(8000)), {kChatter, kBreakage},
                "4, now 6");
  check_stopped("cutoff", planned(changed("monitor.collision", "cutoff_rad_s", 500), signals(8000)),
                {kX, kY}, "observer cutoff [rad/s] 335, now 500");
  check_stopped("observer",
                planned(changed("observer.spindle", "velocity_cutoff_rad_s", 900), signals(8000)),
                {kChatter, kBreakage}, "velocity cutoff [rad/s] 3500, now 900");
  check_stopped("counts of x",
                planned(changed("axis.x", "encoder_counts_per_rev", 65536), signals(8000)), {kX},
                "1048576, now 65536");
  StackSignals positions = signals(8000);
  positions.axis[1]->motion = MotionKind::position;
  check_stopped("a position", planned(learned(), positions), {kY}, "1048576, now 0");
  check_stopped("window",
                planned(changed("monitor.chatter", "window_revolutions", 20), signals(8000)),
                {kChatter}, "revolutions in the window");
  check_stopped("harmonics", planned(changed("monitor.chatter", "harmonics", 20), signals(8000)),
                {kChatter}, "harmonics 10, now 20");
  MachineFile notched = learned();
  notched.set("monitor.collision", "notch_hz", "500, 2000");
  check_stopped("notch", planned(notched, signals(8000)), {kX, kY}, "1000, 2000, now 500, 2000");
}

// A threshold of unknown conditions runs, and the summary says that they are unknown.
void set_by_hand() {
  const StackPlan plan = planned(*MachineFile::parse(kMachine, "m.ini"), signals(8000));
  const StackPlan known = planned(learned(), signals(8000));
  for (const Watcher& w : kAll) {
    const MonitorAvailability m = of(plan, w.monitor, w.channel);
    CHECK(m.runs && contains(m.reason, "set by hand?"));
    CHECK(!contains(of(known, w.monitor, w.channel).reason, "set by hand?"));
  }
}

// Learned anew for x alone at another rate: what y had learned is not passed off as learned then.
void learned_anew() {
  MachineFile file = learned();
  const StackPlan plan = planned(file, signals(2000, false));
  const std::vector<std::string> removed = write_learned_under(file, plan.config, Channel::x);
  CHECK(removed.size() == 3);
  for (const char* key :
       {"threshold_y_N_per_s", "learned_counts_y_per_rev", "cutting_threshold_x_N_per_s"}) {
    CHECK(!file.has("monitor.collision", key));
    CHECK(std::any_of(removed.begin(), removed.end(),
                      [&](const std::string& r) { return contains(r, key); }));
  }
  CHECK(file.has("monitor.collision", "threshold_x_N_per_s"));
  CHECK(of(planned(file, signals(2000)), MonitorId::collision, Channel::x).runs);
  CHECK_TEXT(of(planned(file, signals(2000)), MonitorId::collision, Channel::y).obstacle,
             "no threshold");
  // Under the same conditions nothing is lost.
  MachineFile same = learned();
  CHECK(write_learned_under(same, planned(same, signals(8000, false)).config, Channel::x).empty());
}

}  // namespace

int main() {
  what_differs_stops();
  set_by_hand();
  learned_anew();
  return check::done();
}
