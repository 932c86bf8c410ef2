// Monitor stack that hears of several servo periods as of one: its drives against the same samples
// joined by hand, estimates against the force that was put in, faults on every input of every drive
// at every place in a group, alarms, and the tool.
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>

#include "check.hpp"
#include "four_drives.hpp"
#include "stack_runs.hpp"

namespace {

using namespace four_drives;

constexpr int kGroup[kDrives] = {2, 4, 4, 4};  // samples
constexpr int kLast[kDrives] = {2, 1, 3, 1};   // the last of a group, modulo its length

MonitorStackConfig grouped() { return in_groups(config()); }

// Of the axes, besides discretisation: where the friction has swung over, its mean over a group is
// not the friction of the mean motion. 0.3 % of the 94 to 240 N.
constexpr double kGroupedBound[kDrives] = {0.2, 0.6, 0.6, 0.6};

// What is heard: the sum of motion, the mean effort. By hand, from the input alone.
template <typename Real>
void joined() {
  const auto all = recording<Real>(6000);
  auto stack = std::make_unique<Stack<Real>>();
  stack->configure(grouped());
  const MonitorStackConfig c = config();
  for (std::size_t d = 0; d < kDrives; ++d) {
    stack->reset();
    DriveInput<Real> input;
    input.configure(d == 0 ? c.spindle.input : c.axis[d - 1].input);
    double motion = 0, effort = 0;
    double worst_motion = 0, worst_effort = 0, worst_place = 0;
    int n = 0;
    for (const auto& s : all) {
      stack->process(s);
      ServoSample<Real> copy = s;
      const DriveSample<Real> sample = input.process(raw(copy, d));
      motion += static_cast<double>(sample.increment);
      effort += static_cast<double>(sample.effort);
      if (++n % kGroup[d] != kLast[d] % kGroup[d]) continue;
      const DriveSample<Real>& heard = out(*stack, d).sample;
      if (n > 8) {  // the first is shorter
        worst_motion =
            std::max(worst_motion, std::abs(static_cast<double>(heard.increment) - motion));
        worst_effort = std::max(worst_effort,
                                std::abs(static_cast<double>(heard.effort) - effort / kGroup[d]));
        worst_place =
            std::max(worst_place, std::abs(static_cast<double>(heard.position - sample.position)));
        worst_place =
            std::max(worst_place,
                     std::abs(static_cast<double>(heard.turn_angle_rad - sample.turn_angle_rad)));
      }
      motion = effort = 0;
    }
    // Roundings of a step of 0.1 rad or 1e-4 m, and of some hundred N or a Nm, in float.
    CHECK_BETWEEN(worst_motion, 0.0, d == 0 ? 4e-8 : 4e-11);
    CHECK_BETWEEN(worst_effort, 0.0, 4e-4);
    CHECK(worst_place == 0);
  }
}

template <typename Real>
void steady_cut() {
  (void)four_drives::steady_cut<Real>(grouped(), std::to_array(kGroupedBound));
}

/// x: deceleration, dwell, acceleration, cruise, cruise; z dwells at the last one. Each on another
/// place in a group.
template <typename Real>
void faults() {
  four_drives::faults<Real>({.config = grouped(),
                             .starts = {3000, 3401, 3902, 5051, 5400},
                             .group = std::to_array(kGroup),
                             .bound = std::to_array(kGroupedBound),
                             .settled = kSettled + 16,
                             .spindle_armed = 1010,
                             .axis_armed = kSettled + 270});
}

// First sample of an alarm, as test_monitor_stack.cpp makes them: a contact of y, or a vibration of
// the spindle, which alone need not wait for an even feed.
template <typename Real>
int first_alarm(MonitorStackConfig c, bool contact, bool in_group) {
  if (!contact)
    for (AxisSlotConfig& axis : c.axis) axis.present = false;
  auto stack = std::make_unique<Stack<Real>>();
  stack->configure(in_group ? in_groups(c) : c);
  const auto clean = recording<Real>(8000);
  Mirror<Real> mirror;
  int first = 0;
  for (int n = 0; n < 8000; ++n) {
    ServoSample<Real> s = clean[static_cast<std::size_t>(n)];
    if (contact && n >= 3000 && n < 3032) s.axis[1].effort += static_cast<Real>(40 * (n - 2999));
    if (!contact && n >= 4000)
      s.spindle.effort += static_cast<Real>(std::sin(kTwoPi * 270.0 * n * kPeriod_s));
    const auto changes = stack->process(s);
    mirror.follow(changes, *stack);
    for (const auto& change : changes) {
      if (change.state != MonitorState::alarm) continue;
      CHECK(first == 0);
      first = n;
      CHECK(change.channel == (contact ? Channel::y : Channel::spindle));
      CHECK(change.value >= change.threshold);
    }
  }
  CHECK(mirror.ok);
  return first;
}

// The contact is found within a millisecond of the servo rate (half a group of delay, two groups of
// confirmation for three samples), the vibration within a revolution.
template <typename Real>
void alarms() {
  constexpr int kRevolution = 84;
  for (const bool contact : {true, false}) {
    const int single = first_alarm<Real>(config(), contact, false);
    const int group = first_alarm<Real>(config(), contact, true);
    CHECK(single > (contact ? 3000 : 4000));
    check::figure(std::string(precision<Real>()) + (contact ? ", contact" : ", vibration") +
                      " in groups later by",
                  (group - single) * 0.125, "ms");
    CHECK_BETWEEN(group - single, -8, contact ? 8 : kRevolution);
  }
}

// The monitors of the tool run at the rates of the drives that they hear.
template <typename Real>
void tool() {
  MonitorStackConfig c = config();
  ToolMonitorsConfig& t = c.tool;
  t.ar_breakage_on = t.tooth_breakage_on = t.drill_fracture_on = t.wear_on = true;
  t.ar_breakage.teeth = t.tooth_breakage.teeth = 3;
  t.ar_breakage.noise_Nm = t.tooth_breakage.noise = 0.01;
  t.tooth_breakage.torque = true;
  t.drill_fracture.threshold_N = 5;
  t.wear.cutting_thrust_N = 100;
  t.wear.thrust_limit_N = 500;
  for (std::size_t i = 0; i < 2; ++i) {
    c.axis[i].tool_observer = c.axis[i].monitor_observer;
    c.axis[i].tool_observer.disturbance_cutoff_rad_s = 2500;
    c.axis[i].tool_observer.velocity_cutoff_rad_s = 2500;
  }
  auto stack = std::make_unique<Stack<Real>>();
  const MonitorStackConfig in = in_groups(c);
  CHECK(Stack<Real>::validate(in).ok());
  CHECK(in.tool.drill_fracture.window_samples == (c.tool.drill_fracture.window_samples + 3) / 4);
  stack->configure(in);
  // A force of 8 N that turns with the spindle, clockwise: the drill monitor must read it.
  constexpr double kTurning_N = 8;
  auto all = recording<Real>(16000);
  for (std::size_t n = 0; n < all.size(); ++n) {
    const double angle = kSpeed_rad_s * static_cast<double>(n) * kPeriod_s;
    all[n].axis[0].effort += static_cast<Real>(kTurning_N * std::cos(angle));
    all[n].axis[1].effort -= static_cast<Real>(kTurning_N * std::sin(angle));
  }
  int n = 0, told = 0;
  for (const auto& s : all) {
    for (const auto& change : stack->process(s)) told += change.channel == Channel::tool;
    ++n;
    const auto& tool = stack->tool();
    if (n != 16000) continue;
    CHECK(tool.ar_breakage().state().sample == 8000);
    CHECK(tool.tooth_breakage().state().sample == 8000);
    CHECK(tool.drill_fracture().state().sample == 4000);
    CHECK(tool.wear().state().sample == 4000);
    // Two low-passes of 2500 rad/s in the observer take 1 / (1 + (600/2500)^2) = 0.9455 of it, the
    // mean over four samples 0.996.
    const double expected = kTurning_N * 0.9455 * 0.996;
    check::figure(std::string(precision<Real>()) + ", rotating force of 8 N read as",
                  static_cast<double>(tool.drill_fracture().state().radius_N), "N");
    CHECK_NEAR(static_cast<double>(tool.drill_fracture().state().radius_N), expected, 0.1);
    CHECK(tool.drill_fracture().state().state == MonitorState::alarm);
    CHECK(tool.ar_breakage().state().faults == 0 && tool.tooth_breakage().state().faults == 0);
  }
  CHECK(told >= 4);
}

// A counter that moves more than a group allows, or loses samples, is never lost.
template <typename Real>
void fast_counter() {
  MonitorStackConfig c = config();
  c.spindle.input.max_speed = 0;
  auto stack = std::make_unique<Stack<Real>>();
  stack->configure(in_groups(c));
  DriveInput<Real> input;
  input.configure(c.spindle.input);
  auto all = recording<Real>(4000);
  double heard = 0, moved = 0;
  std::int64_t counts = 0;
  bool same = true;
  for (int n = 0; n < 4000; ++n) {
    ServoSample<Real>& s = all[static_cast<std::size_t>(n)];
    counts += 1000 + (n * 7919 % 4001) * (n / 500) * 60;  // up to 1.7 turns a sample
    s.spindle.counts = counts;
    if (n % 97 < n / 1000) s.spindle.motion_quality = Quality::missing;
    if (n % 61 == 1) s.spindle.effort_quality = Quality::held;
    stack->process(s);
    const DriveSample<Real> sample = input.process(s.spindle);
    moved += static_cast<double>(sample.increment);
    if (n % 2 == 0) continue;
    heard += static_cast<double>(stack->spindle().sample.increment);
    same = same && stack->spindle().sample.position == sample.position &&
           stack->spindle().sample.turn_angle_rad == sample.turn_angle_rad;
  }
  CHECK(same);
  // Sums of 4000 floats of 10 rad.
  CHECK_NEAR(heard, moved, 1e-6 * moved);
}

void refusals() {
  auto refused = [](auto change, const char* parameter) {
    MonitorStackConfig c = grouped();
    change(c);
    const Status s = Stack<float>::validate(c);
    CHECK(!s.ok());
    CHECK_TEXT(s.parameter(), parameter);
  };
  refused([](auto& c) { c.tool.half_rate = true; }, "half_rate");
  refused(
      [](auto& c) {
        c.tool.tooth_breakage_on = true;
        c.tool.tooth_breakage.torque = false;
      },
      "grouped");
}

template <typename Real>
void all() {
  joined<Real>();
  steady_cut<Real>();
  faults<Real>();
  alarms<Real>();
  tool<Real>();
  fast_counter<Real>();
}

}  // namespace

int main() {
  all<float>();
  all<double>();
  refusals();
  return check::done();
}
