// From the machine file to the stack: which monitors run on which signals, and why not.
#include <algorithm>
#include <memory>
#include <string>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace {

using namespace servosense;

const char* const kMachine = R"(
[machine]
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
[axis.z]
lead_m = 0.016
equivalent_mass_kg = 380
moving_mass_kg = 175
vertical = yes
torque_constant_Nm_per_A = 0.8
encoder_counts_per_rev = 1048576
[monitor.chatter]
chatter_threshold_Nm2 = 0.02
[monitor.collision]
threshold_N_per_s = 14580
)";

MachineFile machine(const std::string& more = "", const std::string& base = kMachine) {
  auto file = MachineFile::parse(base + more, "m.ini");
  if (!file) check::fail(__FILE__, __LINE__) << file.error().sentence << '\n';
  return file ? *file : *MachineFile::parse("[machine]\nname = none\n", "none");
}

// Replaces a line of the machine above.
std::string with(const std::string& line, const std::string& by) {
  std::string text = kMachine;
  const std::size_t at = text.find(line);
  CHECK(at != std::string::npos);
  return at == std::string::npos ? text : text.replace(at, line.size(), by);
}

StackSignals signals(double rate_hz) {
  StackSignals s;
  s.sample_period_s = 1 / rate_hz;
  s.spindle = DriveSignal{};
  s.axis[0] = DriveSignal{};
  s.axis[2] = DriveSignal{};
  return s;
}

StackPlan planned(const MachineFile& file, const StackSignals& on) {
  auto plan = plan_stack(file, on);
  ++check::checks;
  if (!plan) check::fail(__FILE__, __LINE__) << plan.error().sentence << '\n';
  return plan ? *plan : StackPlan{};
}

const MonitorAvailability& of(const StackPlan& plan, Channel channel) {
  static const MonitorAvailability none{};
  const auto at = std::find_if(plan.monitors.begin(), plan.monitors.end(),
                               [&](const auto& m) { return m.channel == channel; });
  return at == plan.monitors.end() ? none : *at;
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

bool remarked(const StackPlan& plan, const std::string& part) {
  return std::any_of(plan.remarks.begin(), plan.remarks.end(),
                     [&](const std::string& r) { return contains(r, part); });
}

void says(const std::string& text, const std::string& part, int line) {
  check::that(contains(text, part), ("'" + text + "' says '" + part + "'").c_str(), __FILE__, line);
}

void rates() {
  struct Case {
    double rate_hz;
    bool runs;
    bool lowered;  // 3500 rad/s is too fast for this rate
  };
  for (const Case& c : {Case{10, false, true}, Case{499, false, true}, Case{500, true, true},
                        Case{1000, true, true}, Case{2000, true, true}, Case{4000, true, false},
                        Case{8000, true, false}}) {
    const StackPlan plan = planned(machine(), signals(c.rate_hz));
    // Every monitor is accounted for: chatter, collision, signals of three drives, five of the
    // tool.
    CHECK(plan.monitors.size() == 1 + kAxes + 3 + 5);
    for (const Channel channel : {Channel::spindle, Channel::x, Channel::z}) {
      CHECK(of(plan, channel).runs == c.runs);
      if (!c.runs) says(of(plan, channel).reason, "needs at least 500 Hz", __LINE__);
    }
    CHECK(!of(plan, Channel::y).runs);
    says(of(plan, Channel::y).reason, "needs the axis's position", __LINE__);
    CHECK(remarked(plan, "spindle: cutoff lowered from 3500") == c.lowered);
    // Estimates are there at every rate, with observers that the rate supports.
    CHECK(plan.config.spindle.present && plan.config.axis[0].present &&
          !plan.config.axis[1].present && plan.config.axis[2].present);
    CHECK_NEAR(plan.config.spindle.observer.disturbance_cutoff_rad_s, std::min(3500.0, c.rate_hz),
               1e-9);
    CHECK_NEAR(plan.config.axis[0].observer.disturbance_cutoff_rad_s, std::min(335.0, c.rate_hz),
               1e-9);
    CHECK(HostStack::validate(plan.config).ok());
    // A monitor that does not run has no threshold, so that it idles.
    CHECK((plan.config.axis[0].collision.threshold_N_per_s > 0) == c.runs);
    CHECK((plan.config.spindle.chatter.chatter_threshold_Nm2 > 0) == c.runs);
    // The hold that ends an alarm is a tenth of a second at every rate.
    CHECK(plan.config.axis[0].collision.release_samples ==
          static_cast<unsigned>(std::max(1.0, 0.1 * c.rate_hz)));
  }
}

void cutoffs() {
  // The monitors' own cutoffs (Koike 2016, table 3-3) where nothing is stated...
  const StackPlan standard = planned(machine(), signals(8000));
  CHECK(standard.remarks.empty());
  CHECK(standard.config.axis[0].monitor_observer.disturbance_cutoff_rad_s == 335);
  CHECK(standard.config.axis[0].monitor_observer.velocity_cutoff_rad_s == 335);
  CHECK(standard.config.axis[0].collision.cutoff_rad_s == 335);
  CHECK(standard.config.spindle.monitor_observer.disturbance_cutoff_rad_s == 3500);
  // ...beside an estimate with the user's own, each drive by itself...
  const StackPlan own = planned(machine("[observer.x]\ndisturbance_cutoff_rad_s = 700\n"
                                        "velocity_cutoff_rad_s = 2000\n"),
                                signals(8000));
  CHECK(own.config.axis[0].observer.disturbance_cutoff_rad_s == 700);
  CHECK(own.config.axis[0].observer.velocity_cutoff_rad_s == 2000);
  CHECK(own.config.axis[0].monitor_observer.disturbance_cutoff_rad_s == 335);
  CHECK(own.config.axis[0].monitor_observer.velocity_cutoff_rad_s == 335);
  CHECK(own.config.axis[2].observer.disturbance_cutoff_rad_s == 335);
  // ...and a cutoff that is too high is lowered aloud, once a cause.
  const StackPlan fast = planned(machine("[observer.x]\ndisturbance_cutoff_rad_s = 9000\n"
                                         "velocity_cutoff_rad_s = 500\n"),
                                 signals(8000));
  CHECK(fast.config.axis[0].observer.disturbance_cutoff_rad_s == 8000);
  CHECK(fast.config.axis[0].observer.velocity_cutoff_rad_s == 500);
  CHECK(fast.remarks.size() == 1 && remarked(fast, "x: cutoff lowered from 9000 to 8000 rad/s"));
  const StackPlan slow = planned(machine(), signals(1000));
  CHECK(slow.remarks.size() == 1);  // the spindle's; its monitor shares the observer
  MachineFile asked = machine("[observer.x]\ndisturbance_cutoff_rad_s = 700\n");
  asked.set("monitor.collision", "cutoff_rad_s", 9000.0);
  const StackPlan monitor = planned(asked, signals(8000));
  CHECK(monitor.config.axis[0].collision.cutoff_rad_s == 8000);
  CHECK(monitor.config.axis[0].monitor_observer.disturbance_cutoff_rad_s == 8000);
  CHECK(remarked(monitor, "collision on x: cutoff lowered from 9000"));
}

void thresholds() {
  MachineFile file = machine();
  file.set("monitor.collision", "threshold_z_N_per_s", 32160.0);
  StackPlan plan = planned(file, signals(8000));
  CHECK(plan.config.axis[0].collision.threshold_N_per_s == 14580);  // for all axes
  CHECK(plan.config.axis[2].collision.threshold_N_per_s == 32160);  // its own
  says(of(plan, Channel::z).reason, "3 samples beyond 3.216e+04 N/s", __LINE__);
  file.remove("monitor.collision", "threshold_N_per_s");
  plan = planned(file, signals(8000));
  CHECK(!of(plan, Channel::x).runs && of(plan, Channel::z).runs);
  says(of(plan, Channel::x).reason, "threshold_x_N_per_s", __LINE__);
  says(of(plan, Channel::x).reason, "servosense identify idle", __LINE__);
  file.set("monitor.collision", "enabled", "no");
  plan = planned(file, signals(8000));
  CHECK(!of(plan, Channel::z).runs && plan.config.axis[2].collision.threshold_N_per_s == 0);
  says(of(plan, Channel::z).reason, "switched off", __LINE__);
  CHECK(of(plan, Channel::spindle).runs);

  file = machine();
  file.remove("monitor.chatter", "chatter_threshold_Nm2");
  plan = planned(file, signals(8000));
  CHECK(!of(plan, Channel::spindle).runs);
  says(of(plan, Channel::spindle).reason, "chatter_threshold_Nm2", __LINE__);

  // What else a monitor takes from its section.
  file = machine();
  file.set("monitor.collision", "consecutive_samples", 5);
  file.set("monitor.collision", "warning_fraction", 0.4);
  file.set("monitor.collision", "notch_hz", "50, 100");
  file.set("monitor.chatter", "window_revolutions", 6);
  file.set("monitor.chatter", "harmonics", 4);
  file.set("monitor.chatter", "minimum_speed_rad_s", 50);
  plan = planned(file, signals(8000));
  const CollisionConfig& x = plan.config.axis[0].collision;
  CHECK(x.consecutive_samples == 5 && x.notch_hz[0] == 50 && x.notch_hz[1] == 100);
  CHECK(x.warning_fraction == 0.4 && x.release_fraction <= 0.4);
  const ChatterConfig& chatter = plan.config.spindle.chatter;
  CHECK(chatter.window_revolutions == 6 && chatter.consecutive_revolutions == 1);
  CHECK(chatter.harmonics == 4 && chatter.minimum_speed_rad_s == 50);
}

// Scales: amperes to force at the stage, counts to metres.
void scales() {
  const StackPlan plan = planned(machine(), signals(8000));
  CHECK(plan.config.axis[0].input.effort_per_unit == 200);
  CHECK_NEAR(plan.config.axis[2].input.effort_per_unit, 0.8 * kTwoPi / 0.016, 1e-12 * 314);
  CHECK_NEAR(plan.config.axis[0].input.unit_per_count, 0.016 / 1048576, 1e-22);
  CHECK(plan.config.spindle.input.effort_per_unit == 0.5);
  CHECK_NEAR(plan.config.axis[2].observer.drive.constant_load, 175 * 9.80665, 1e-9);
  StackSignals torque = signals(8000);
  torque.axis[0] = DriveSignal{MotionKind::position, EffortKind::torque_Nm};
  torque.axis[2] = DriveSignal{MotionKind::velocity, EffortKind::force_N};
  const StackPlan other = planned(machine(), torque);
  CHECK_NEAR(other.config.axis[0].input.effort_per_unit, kTwoPi / 0.016, 1e-12 * 393);
  CHECK(other.config.axis[2].input.effort_per_unit == 1);
}

// One drive that cannot be scaled is left out and says why; none at all is an error.
void unfit_machine() {
  auto left_out = [](const std::string& text, Channel channel, const std::string& part, int line) {
    const StackPlan plan = planned(machine("", text), signals(8000));
    const MonitorAvailability& m = of(plan, channel);
    check::that(!m.runs, "does not run", __FILE__, line);
    says(m.reason, part, line);
    says(m.reason, "m.ini", line);
  };
  left_out(with("encoder_counts_per_rev = 131072\n", ""), Channel::spindle,
           "encoder_counts_per_rev", __LINE__);
  left_out(with("torque_constant_Nm_per_A = 0.5\n", ""), Channel::spindle,
           "torque_constant_Nm_per_A", __LINE__);
  left_out(with("force_constant_N_per_A = 200\n", ""), Channel::x, "torque_constant_Nm_per_A",
           __LINE__);
  left_out(with("[axis.x]\nlead_m = 0.016\n", "[axis.x]\n"), Channel::x, "lead_m", __LINE__);
  left_out(with("[axis.x]", "[axis.y]"), Channel::x, "[axis.x]", __LINE__);

  StackSignals only_x = signals(8000);
  only_x.spindle.reset();
  only_x.axis[2].reset();
  auto plan = plan_stack(machine("", with("[axis.x]", "[axis.y]")), only_x);
  CHECK(!plan && plan.error().kind == ErrorKind::data);
  if (!plan) says(plan.error().sentence, "[axis.x]", __LINE__);
  StackSignals none;
  auto nothing = plan_stack(machine(), none);
  CHECK(!nothing && nothing.error().kind == ErrorKind::data);

  // What a block refuses, in the words of the file: line, section and key.
  struct Refused {
    const char* section;
    const char* key;
    double value;
  };
  for (const Refused& r : {Refused{"monitor.chatter", "window_revolutions", kHostRevolutions + 1},
                           Refused{"monitor.chatter", "harmonics", kHostHarmonics + 1},
                           Refused{"monitor.chatter", "minimum_speed_rad_s", 1e-300},
                           Refused{"spindle", "encoder_counts_per_rev", 1e-300},
                           Refused{"axis.x", "encoder_counts_per_rev", 1e-300},
                           Refused{"monitor.tooth-breakage", "noise_Nm", 1e-300},
                           Refused{"monitor.wear", "thrust_ratio", 0.5}}) {
    MachineFile file = machine(
        "[tool]\nteeth = 4\n[monitor.wear]\ncutting_thrust_N = 120\nthrust_limit_N = 800\n");
    file.set(r.section, r.key, r.value);
    auto refused = plan_stack(file, signals(8000));
    CHECK(!refused && refused.error().kind == ErrorKind::data);
    if (refused) continue;
    says(refused.error().sentence, std::string(r.key) + " in [" + r.section + "]", __LINE__);
    says(refused.error().sentence, "m.ini:", __LINE__);
  }
}

// Wear: its keys reach the monitor, and a tool that was taught elsewhere needs no teaching.
void wear_keys() {
  const MachineFile file = machine(
      "[monitor.wear]\ncutting_thrust_N = 120\nthrust_limit_N = 800\nminimum_speed_rad_s = 25\n"
      "friction_error_N = 70\nfriction_drift_N = 2\nfriction_noise_N = 6\n"
      "taught_thrust_N = 350\ntaught_thrust_scatter_N = 9\n");
  const StackPlan plan = planned(file, signals(8000));
  const WearConfig& w = plan.config.tool.wear;
  CHECK(plan.config.tool.wear_on && w.minimum_speed_rad_s == 25 && w.friction_error_N == 70 &&
        w.friction_drift_N == 2 && w.friction_noise_N == 6);
  auto stack = std::make_unique<HostStack>();
  prepare(*stack, plan);
  const auto& taught = stack->tool().wear().tool();
  CHECK(taught.thrust.taught == 350 && taught.thrust.scatter == 9 && taught.torque.taught == 0);
  CHECK(taught.taught == w.teach_holes);
  prepare(*stack, planned(machine(), signals(8000)));
  CHECK(stack->tool().wear().tool().taught == 0);
}

// From 8 kHz on drill fracture and wear run at half the rate, over the same stretches of time.
void half_rate() {
  StackSignals all = signals(8000);
  all.axis[1] = all.axis[0];
  const char* drill =
      "[axis.y]\nlead_m = 0.016\nequivalent_mass_kg = 325\n"
      "force_constant_N_per_A = 200\nencoder_counts_per_rev = 1048576\n"
      "[monitor.drill-fracture]\nthreshold_N = 20\nwindow_samples = 480\n";
  const StackPlan fast = planned(machine(drill), all);
  const ToolMonitorsConfig& half = fast.config.tool;
  CHECK(half.half_rate && half.drill_fracture_on);
  CHECK_NEAR(half.drill_fracture.sample_period_s, 250e-6, 1e-12);
  CHECK_NEAR(half.wear.sample_period_s, 250e-6, 1e-12);
  CHECK(half.drill_fracture.window_samples == 240);
  CHECK_NEAR(fast.config.axis[1].tool_observer.sample_period_s, 250e-6, 1e-12);
  all.sample_period_s = 250e-6;
  const StackPlan slow = planned(machine(drill), all);
  CHECK(!slow.config.tool.half_rate && slow.config.tool.drill_fracture.window_samples == 480);
  CHECK_NEAR(slow.config.axis[1].tool_observer.sample_period_s, 250e-6, 1e-12);
}

std::string in_groups_machine() {
  std::string text = kMachine;
  const std::string section = "[machine]\n";
  return text.insert(text.find(section) + section.size(), "grouped_monitors = yes\n");
}

// grouped_monitors: thresholds are learned at the servo rate, the stack runs in groups, from 8 kHz
// on.
void groups() {
  const StackPlan single = planned(machine(), signals(8000));
  CHECK(!single.grouped);
  const StackPlan plan = planned(machine("", in_groups_machine()), signals(8000));
  CHECK(plan.grouped && !plan.config.grouped && plan.remarks.size() == single.remarks.size() + 1);
  CHECK_NEAR(plan.config.spindle.chatter.sample_period_s, 125e-6, 1e-12);
  const HostStackConfig run = in_groups(plan.config);
  CHECK(run.grouped && !run.tool.half_rate && HostStack::validate(run).ok());
  CHECK_NEAR(run.spindle.chatter.sample_period_s, 250e-6, 1e-12);
  CHECK_NEAR(run.spindle.input.sample_period_s, 125e-6, 1e-12);
  for (const HostAxisSlotConfig& axis : run.axis) {
    if (!axis.present) continue;
    CHECK_NEAR(axis.observer.sample_period_s, 500e-6, 1e-12);
    CHECK_NEAR(axis.collision.sample_period_s, 500e-6, 1e-12);
    CHECK_NEAR(axis.tool_observer.sample_period_s, 500e-6, 1e-12);
    CHECK(axis.collision.consecutive_samples == 2 && axis.collision.release_samples == 200);
  }
  CHECK_NEAR(run.tool.wear.sample_period_s, 500e-6, 1e-12);
  StackSignals slow = signals(4000);
  slow.sample_period_s = 250e-6;
  const StackPlan none = planned(machine("", in_groups_machine()), slow);
  CHECK(!none.grouped && !none.remarks.empty());
}

}  // namespace

int main() {
  rates();
  cutoffs();
  thresholds();
  scales();
  unfit_machine();
  wear_keys();
  half_rate();
  groups();
  return check::done();
}
