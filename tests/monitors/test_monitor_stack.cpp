// Monitor stack on four drives whose efforts follow from their motion in closed form: estimates
// against the force that was put in, faults on every input of every drive, wiring, absent drives.
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "check.hpp"
#include "four_drives.hpp"
#include "koike_stack.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/core/units.hpp"
#include "stack_runs.hpp"

namespace {

using namespace servosense;
using namespace koike;
using namespace four_drives;

// ---- estimates ---------------------------------------------------------------------------------

template <typename Real>
void steady_cut() {
  CHECK(four_drives::steady_cut<Real>(config(), std::to_array(kBound)) == 16'000);
}

// ---- faults ------------------------------------------------------------------------------------

/// x: deceleration, dwell, acceleration, cruise, cruise; z dwells at the last one. Observer and
/// jerk settle one after the other; chatter needs nine revolutions, 84 samples each, behind its
/// observer.
template <typename Real>
void faults() {
  four_drives::faults<Real>({.config = config(),
                             .starts = {3000, 3400, 3900, 5050, 5400},
                             .group = {1, 1, 1, 1},
                             .bound = std::to_array(kBound),
                             .settled = kSettled,
                             .spindle_armed = 1000,
                             .axis_armed = kSettled + 240});
}

// ---- wiring ------------------------------------------------------------------------------------

// A contact on one axis is that axis's alarm, vibration of the torque is the spindle's; each once:
// the vibration is more than all load, so no change of the feed explains it and its alarm goes on.
template <typename Real>
void alarms(bool with_axes) {
  auto stack = std::make_unique<Stack<Real>>();
  MonitorStackConfig c = config();
  for (AxisSlotConfig& axis : c.axis) axis.present = with_axes;
  stack->configure(c);
  const auto clean = recording<Real>(8000);
  std::vector<StateChange<Real>> raised;
  Mirror<Real> mirror;
  for (int n = 0; n < 8000; ++n) {
    ServoSample<Real> s = clean[static_cast<std::size_t>(n)];
    if (n >= 3000 && n < 3032) s.axis[1].effort += static_cast<Real>(40 * (n - 2999));
    if (n >= 4000) s.spindle.effort += static_cast<Real>(std::sin(kTwoPi * 270.0 * n * kPeriod_s));
    const auto changes = stack->process(s);
    mirror.follow(changes, *stack);
    for (const auto& change : changes)
      if (change.state == MonitorState::alarm) raised.push_back(change);
  }
  CHECK(mirror.ok);
  const std::size_t first = with_axes ? 1 : 0;
  CHECK(raised.size() == (with_axes ? 2U : 1U));
  if (raised.size() <= first) return;
  for (std::size_t i = first; i < raised.size(); ++i) {
    CHECK(raised[i].channel == Channel::spindle && raised[i].monitor == MonitorId::chatter);
    CHECK(raised[i].detail == 0 && raised[i].value >= raised[i].threshold);
  }
  if (!with_axes) return;
  CHECK(raised[0].channel == Channel::y && raised[0].monitor == MonitorId::collision);
  CHECK(raised[0].value >= raised[0].threshold && raised[0].threshold == Real(5000));
  CHECK(stack->collision(1).state().alarms == 1 && stack->collision(0).state().alarms == 0);
}

// With cutoffs of its own, the monitor listens to an observer of its own: the chain of blocks put
// together by hand gives the same bits.
template <typename Real>
void own_observer() {
  MonitorStackConfig c = config();
  c.axis[0].observer.disturbance_cutoff_rad_s = 900;
  auto stack = std::make_unique<Stack<Real>>();
  stack->configure(c);
  DriveInput<Real> input;
  DisturbanceObserver<Real> reported, listened;
  auto monitor = std::make_unique<CollisionMonitor<Real>>();
  input.configure(c.axis[0].input);
  reported.configure(c.axis[0].observer);
  listened.configure(c.axis[0].monitor_observer);
  monitor->configure(c.axis[0].collision);
  bool same = true, apart = false;
  for (const auto& s : recording<Real>(4000)) {
    stack->process(s);
    const DriveSample<Real> sample = input.process(s.axis[0]);
    const Real estimate = reported.process(sample);
    const Real force = listened.process(sample);
    monitor->process(force, listened.state().quality);
    same = same && stack->axis(0).estimate == estimate &&
           stack->collision(0).state().jerk_N_per_s == monitor->state().jerk_N_per_s;
    apart = apart || estimate != force;
  }
  CHECK(same);
  CHECK(apart);
}

/// The monitors of the tool hear what they would hear alone, and report every change.
template <typename Real>
void tool_monitors() {
  MonitorStackConfig c = config();
  c.tool.ar_breakage_on = c.tool.tooth_breakage_on = c.tool.drill_fracture_on = c.tool.wear_on =
      true;
  c.tool.ar_breakage.teeth = c.tool.tooth_breakage.teeth = 3;
  c.tool.ar_breakage.noise_Nm = c.tool.tooth_breakage.noise = 0.01;
  c.tool.tooth_breakage.torque = true;
  c.tool.drill_fracture.threshold_N = 5;
  c.tool.wear.cutting_thrust_N = 100;
  c.tool.wear.thrust_limit_N = 500;
  for (std::size_t i = 0; i < 2; ++i) {
    c.axis[i].tool_observer = c.axis[i].monitor_observer;
    c.axis[i].tool_observer.disturbance_cutoff_rad_s = 2500;
    c.axis[i].tool_observer.velocity_cutoff_rad_s = 2500;
  }
  CHECK(Stack<Real>::validate(c).ok());
  auto stack = std::make_unique<Stack<Real>>();
  auto alone = std::make_unique<ToolMonitors<Real, 8>>();
  stack->configure(c);
  alone->configure(c.tool);
  std::array<DriveInput<Real>, kDrives> input;
  std::array<DisturbanceObserver<Real>, kDrives> reported;
  DisturbanceObserver<Real> torque, x, y;
  input[0].configure(c.spindle.input);
  reported[0].configure(c.spindle.observer);
  for (std::size_t i = 0; i < kAxes; ++i) {
    input[i + 1].configure(c.axis[i].input);
    reported[i + 1].configure(c.axis[i].observer);
  }
  torque.configure(c.spindle.monitor_observer);
  x.configure(c.axis[0].tool_observer);
  y.configure(c.axis[1].tool_observer);
  bool same = true;
  int told = 0, expected = 0;
  for (const auto& s : recording<Real>(12000)) {
    for (const StateChange<Real>& change : stack->process(s))
      told += change.channel == Channel::tool;
    const DriveSample<Real> spindle = input[0].process(s.spindle);
    std::array<DriveSample<Real>, kAxes> axis;
    for (std::size_t i = 0; i < kAxes; ++i) axis[i] = input[i + 1].process(s.axis[i]);
    ToolSample<Real> in;
    in.torque_Nm = torque.process(spindle);
    in.level_torque_Nm = reported[0].process(spindle);
    in.turn_angle_rad = spindle.turn_angle_rad;
    in.increment_rad = spindle.increment;
    in.spindle = torque.state().quality;
    in.force_x_N = x.process(axis[0]);
    in.force_y_N = y.process(axis[1]);
    in.lateral = x.state().quality | y.state().quality;
    in.thrust_N = reported[3].process(axis[2]);
    in.feed_m = axis[2].increment;
    in.thrust = reported[3].state().quality;
    alone->process(in, [&](auto&&...) { ++expected; });
    same = same &&
           stack->tool().ar_breakage().state().state == alone->ar_breakage().state().state &&
           stack->tool().tooth_breakage().core().state().value ==
               alone->tooth_breakage().core().state().value &&
           stack->tool().drill_fracture().state().radius_N ==
               alone->drill_fracture().state().radius_N &&
           stack->tool().wear().state().sample == alone->wear().state().sample;
  }
  CHECK(same);
  CHECK(told == expected && expected >= 4);

  // Without room for teeth the monitors of the tool are not there.
  auto bare = std::make_unique<MonitorStack<Real, 8, 10, 1024, 0>>();
  bare->configure(c);
  for (const auto& s : recording<Real>(500))
    for (const auto& change : bare->process(s)) CHECK(change.channel != Channel::tool);
}

template <typename Real>
void absent_drives() {
  const auto all = recording<Real>(2000);
  auto full = std::make_unique<Stack<Real>>();
  auto part = std::make_unique<Stack<Real>>();
  for (unsigned present = 0; present < 1U << kDrives; ++present) {
    MonitorStackConfig c = config();
    c.spindle.present = (present & 1U) != 0;
    for (std::size_t i = 0; i < kAxes; ++i) {
      c.axis[i].present = (present >> (i + 1) & 1U) != 0;
      // What is absent is not looked at.
      if (!c.axis[i].present) c.axis[i].observer.disturbance_cutoff_rad_s = -1;
    }
    CHECK(Stack<Real>::validate(c).ok() == (present != 0));
    full->configure(config());
    part->configure(c);
    Mirror<Real> mirror;
    bool same = true;
    for (const auto& s : all) {
      full->process(s);
      mirror.follow(part->process(s), *part);
      for (std::size_t d = 0; d < kDrives; ++d)
        same = same && out(*part, d).estimate ==
                           ((present >> d & 1U) != 0 ? out(*full, d).estimate : Real(0));
    }
    CHECK(same && mirror.ok);
    for (std::size_t d = 0; d < kDrives; ++d)
      CHECK(out(*part, d).state ==
            ((present >> d & 1U) != 0 ? MonitorState::armed : MonitorState::idle));
  }
}

// Reset is as good as new.
template <typename Real>
void reset() {
  auto stack = std::make_unique<Stack<Real>>();
  stack->configure(config());
  const auto all = recording<Real>(3000);
  std::vector<Real> first;
  for (const auto& s : all) {
    stack->process(s);
    for (std::size_t d = 0; d < kDrives; ++d) first.push_back(out(*stack, d).estimate);
  }
  stack->reset();
  CHECK(stack->samples() == 0);
  std::size_t at = 0;
  bool same = true;
  int changes = 0;
  for (const auto& s : all) {
    for (const StateChange<Real>& c : stack->process(s)) changes += c.monitor != MonitorId::signal;
    for (std::size_t d = 0; d < kDrives; ++d) same = same && out(*stack, d).estimate == first[at++];
  }
  CHECK(same);
  CHECK(changes == 2 * static_cast<int>(kDrives));
}

void refusals() {
  auto refused = [](auto change, const char* parameter) {
    MonitorStackConfig c = config();
    change(c);
    const Status s = Stack<float>::validate(c);
    CHECK(!s.ok());
    CHECK_TEXT(s.parameter(), parameter);
  };
  refused([](auto& c) { c.spindle.input.unit_per_count = 0; }, "unit_per_count");
  refused([](auto& c) { c.spindle.chatter.harmonics = 11; }, "harmonics");
  refused([](auto& c) { c.axis[2].observer.disturbance_cutoff_rad_s = 0; },
          "disturbance_cutoff_rad_s");
  refused([](auto& c) { c.axis[1].monitor_observer.velocity_cutoff_rad_s = 16'000; },
          "velocity_cutoff_rad_s");
  refused([](auto& c) { c.axis[0].collision.threshold_N_per_s = kNan; }, "threshold_N_per_s");
  // What could not alarm.
  refused([](auto& c) { c = MonitorStackConfig{}; }, "present");
  refused(
      [](auto& c) {
        c.spindle.chatter.chatter_threshold_Nm2 = c.spindle.chatter.forced_threshold_Nm2 = 0;
      },
      "chatter_threshold_Nm2");
  refused([](auto& c) { c.axis[1].collision.threshold_N_per_s = 0; }, "threshold_N_per_s");
  refused([](auto& c) { c.spindle.observer.drive.inertia = 0; }, "inertia");
  refused([](auto& c) { c.axis[2].monitor_observer.drive.inertia = 0; }, "inertia");
  refused([](auto& c) { c.axis[1].input.unit_per_turn = DriveInputConfig{}.unit_per_turn; },
          "unit_per_turn");
  // Estimates alone, said on purpose.
  MonitorStackConfig c = config();
  c.spindle.chatter_on = false;
  c.spindle.chatter.chatter_threshold_Nm2 = c.spindle.observer.drive.inertia = 0;
  for (AxisSlotConfig& axis : c.axis) {
    axis.collision_on = false;
    axis.collision.threshold_N_per_s = axis.observer.drive.inertia = 0;
  }
  CHECK(Stack<float>::validate(c).ok());
}

// Before it is configured a stack says so, with every sample.
template <typename Real>
void unconfigured() {
  auto stack = std::make_unique<Stack<Real>>();
  ServoSample<Real> sample;
  for (int i = 0; i < 3; ++i) {
    const auto changes = stack->process(sample);
    CHECK(changes.size() == 1);
    if (changes.size() != 1) return;
    CHECK(changes[0].state == MonitorState::signal_fault);
    CHECK(changes[0].monitor == MonitorId::signal && changes[0].channel == Channel::machine);
  }
  CHECK(stack->spindle().signal == MonitorState::signal_fault);
  CHECK(stack->axis(0).signal == MonitorState::signal_fault);
  stack->configure(config());
  CHECK(stack->spindle().signal == MonitorState::learning);
  for (const auto& change : stack->process(sample)) CHECK(change.channel != Channel::machine);
}

template <typename Real>
void all() {
  unconfigured<Real>();
  steady_cut<Real>();
  faults<Real>();
  alarms<Real>(true);
  alarms<Real>(false);
  own_observer<Real>();
  tool_monitors<Real>();
  absent_drives<Real>();
  reset<Real>();
}

}  // namespace

int main() {
  all<float>();
  all<double>();
  refusals();
  return check::done();
}
