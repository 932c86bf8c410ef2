// A simulated machine with the loop closed: a random cut between its drives, watched by the
// monitors as they are, and what a rule commands on their alarms, which is OverrideControl or a
// rival of it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <vector>

#include "chatter_advice.hpp"
#include "check.hpp"
#include "detection/random_cuts.hpp"
#include "servosense/monitors/override_control.hpp"

namespace detection {

using cli::ChatterAdvice;

enum class Rule {
  none,
  loop,
  with_variation,  ///< of the spindle speed, before less feed
  half_feed,       ///< while an alarm stands, or the load is above 1
  hold,            ///< at the first of these
  current_hold,    ///< at the first current of x above a limit
  touch_hold,      ///< with the touch itself, which nobody is told of: the best there could be
};
inline constexpr const char* kRuleNames[] = {"nothing",          "loop", "loop with variation",
                                             "half feed",        "hold", "hold by current",
                                             "hold at the touch"};

/// The user's.
[[nodiscard]] inline OverrideConfig limits(Rule rule) {
  OverrideConfig c;
  c.sample_period_s = kPeriod_s;
  c.least_speed = 0.6;
  c.greatest_speed = 1.5;
  c.least_feed = 0.5;
  c.greatest_feed = 1.1;
  c.speed_rate_per_s = c.feed_rate_per_s = 1;
  c.variation_amplitude = rule == Rule::with_variation ? 0.1 : 0;
  c.variation_hz = 1.5;
  return c;
}

struct LoopOutcome {
  bool alarmed = false, held = false, finished = false, lost = false, commanded = false;
  OverridePhase last = OverridePhase::programmed;
  bool overloaded = false, collided = false;  ///< this has commanded something
  double alarm_s = kNever, hold_s = kNever, end_s = 0;
  double after = 0;   ///< largest vibration from kQuiet_s after the alarm on, in feeds per tooth
  double steady = 0;  ///< largest vibration at full engagement, likewise
};

/// What comes between what is commanded and the machine.
using Through = std::function<MachineOverride(double t_s, const MachineOverride&)>;
/// A servo instant as it was, and what is commanded from the next on.
using Watch = std::function<void(const MachineSample&, const HostStack&, const MachineOverride&)>;

struct LoopOptions {
  Rule rule = Rule::none;
  double false_at_s = kNever;     ///< a chatter alarm that is none, so long after full engagement
  double torque_limit_Nm = 0;     ///< [limits] torque_Nm; 0: none
  bool collision = false;         ///< its alarms are heard
  double force_limit_N = kNever;  ///< of the motor of x, for Rule::current_hold
  Through through = {};
  Watch watch = {};
};

inline constexpr double kAdviceAfter_s = 0.1;  // the alarm: what it takes to look for pockets
inline constexpr double kQuiet_s = 1;          // after the alarm, as it is asked for
inline constexpr double kHeld_s = 1;           // watched after a hold
inline constexpr double kFalse_s = 0.3;        // a false alarm lasts

[[nodiscard]] inline LoopOutcome run_loop(const Cut& c, const StackPlan& plan,
                                          const ChatterAdvice& advice, const LoopOptions& options) {
  MachineSimulator machine = good(MachineSimulator::create(c.simulation), c.text.c_str());
  auto stack = std::make_unique<HostStack>();
  stack->configure(plan.config);
  OverrideControl<double> control;
  const OverrideConfig config = limits(options.rule);
  const Status valid = OverrideControl<double>::validate(config);
  CHECK(valid.ok());
  control.configure(config);
  OverrideInput<double> in;
  Record r;
  r.schedule = machine.schedule();
  Reporter<double> reporter(c, r, c.seed + 1);
  LoopOutcome o;
  const double full_s = r.schedule.contact_s + c.entry_s;
  const double newton_per_A = c.simulation.x ? c.simulation.x->effort_per_A : 0;
  double advice_s = kNever;
  bool chatter = false, asked = false;
  std::array<bool, kAxes> collides{};
  MachineOverride set, in_effect;
  const auto most = static_cast<std::size_t>(3 * r.schedule.run_down_s / kPeriod_s);
  for (std::size_t i = 0; i < most && machine.program_s() < r.schedule.run_down_s; ++i) {
    const MachineSample s = machine.step();
    r.add(s);
    if (machine.milling().lost()) {
      o.lost = true;
      break;
    }
    for (const auto& change : stack->process(reporter.at(i))) {
      const bool alarm = change.state == MonitorState::alarm;
      if (change.monitor == MonitorId::chatter && change.detail == 0) chatter = alarm;
      if (change.monitor == MonitorId::collision && !is_spindle(change.channel))
        collides[axis_index(change.channel)] = alarm;
    }
    const double since = s.t_s - full_s - options.false_at_s;
    in.chatter = chatter || (since >= 0 && since < kFalse_s);
    if (in.chatter && o.alarm_s == kNever) o.alarm_s = s.t_s;
    const auto& cut = stack->cut().state();
    in.in_cut = cut.cut == CutPresence::cutting;
    in.load = options.torque_limit_Nm > 0 && !cut.unseen
                  ? std::abs(cut.torque_Nm) / options.torque_limit_Nm
                  : OverrideInput<double>::kUnknown;
    in.feed_in_effect = in_effect.feed;
    in.collision = options.collision && std::ranges::any_of(collides, [](bool b) { return b; });
    const bool trouble = in.chatter || in.load > 1 || in.collision;
    switch (options.rule) {
      case Rule::none:
        break;
      case Rule::half_feed:
        set.feed = trouble ? 0.5 : 1;
        o.commanded = o.commanded || trouble;
        break;
      case Rule::hold:
        set.hold = set.hold || trouble;
        break;
      case Rule::current_hold:
        set.hold = set.hold || std::abs(s.x->current_A) * newton_per_A > options.force_limit_N;
        break;
      case Rule::touch_hold:
        set.hold = set.hold || s.obstacle_N > 0;
        break;
      case Rule::loop:
      case Rule::with_variation: {
        if (in.chatter && control.state().phase == OverridePhase::programmed &&
            advice_s == kNever && !asked)
          advice_s = s.t_s + kAdviceAfter_s;
        if (s.t_s >= advice_s) {
          asked = true;
          advice_s = kNever;
          const double rpm = rpm_from_rad_s(machine.spindle_reference(machine.program_s()));
          // The faster one first: it costs no time, and pockets widen with the speed.
          auto speeds =
              advice.advised_speeds(rpm, config.least_speed * rpm, config.greatest_speed * rpm).rpm;
          std::reverse(speeds.begin(), speeds.end());
          for (std::size_t k = 0; k < speeds.size() && k < 2; ++k) in.advised[k] = speeds[k] / rpm;
        }
        in.advice_pending = s.t_s < advice_s && advice_s < kNever;
        const auto& said = control.process(in);
        set = {said.speed_ratio, said.feed_ratio, said.hold};
        if (said.phase != OverridePhase::programmed) o.last = said.phase;
        o.overloaded = o.overloaded || said.overloaded;
        o.collided = o.collided || in.collision;
        o.commanded =
            o.commanded || said.phase != OverridePhase::programmed || said.overloaded || said.hold;
        break;
      }
    }
    if (options.watch) options.watch(s, *stack, set);
    if (set.hold && o.hold_s == kNever) o.hold_s = s.t_s;
    if (s.t_s >= o.hold_s + kHeld_s) break;
    in_effect = options.through ? options.through(s.t_s, set) : set;
    machine.set(in_effect);
  }
  o.alarmed = o.alarm_s < kNever;
  o.held = o.hold_s < kNever;
  o.finished = !o.held && !o.lost && machine.program_s() >= r.schedule.run_down_s;
  o.end_s = static_cast<double>(r.size()) * kPeriod_s;
  std::vector<double> unlike_Nm2;
  detail::find_vibration(c, r, unlike_Nm2);
  const double feed = c.milling().cut.feed_per_tooth_m;
  const double stop_s =
      o.finished ? o.end_s - (r.schedule.run_down_s - r.schedule.stop_s) : o.end_s;
  for (std::size_t i = 0; i < r.size(); ++i) {
    const double t = static_cast<double>(i) * kPeriod_s;
    const double v = static_cast<double>(r.vibration_m[i]) / feed;
    if (t > full_s + 4 * c.turn_s() && t < stop_s) o.steady = std::max(o.steady, v);
    if (t > o.alarm_s + kQuiet_s && t < stop_s) o.after = std::max(o.after, v);
  }
  if (o.lost) o.after = HUGE_VAL;
  return o;
}

}  // namespace detection
