#include "override_watch.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <utility>

#include "console.hpp"
#include "servosense/core/units.hpp"
#include "servosense/hal/real_time_thread.hpp"
#include "servosense/monitors/override_keys.hpp"

namespace servosense::cli {
namespace {

constexpr double kTold = 0.01;  // a change of a ratio that is worth a line

std::string percent(double ratio) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f %%", 100 * ratio);
  return text;
}

}  // namespace

Expected<std::optional<OverrideWatch>> OverrideWatch::open(const MachineFile& machine,
                                                           const StackPlan& plan,
                                                           const ChatterAdvice& advice,
                                                           const std::optional<std::string>& file,
                                                           bool live) {
  const double period_s = plan.config.spindle.chatter.sample_period_s;
  auto config = override_config(machine, period_s);
  if (!config) return config.error();
  if (!*config) {
    if (file)
      return usage_error("--commands writes what is commanded; the machine file has no [override]");
    return std::optional<OverrideWatch>{};
  }
  OverrideWatch watch(**config, plan, advice, live);
  watch.torque_limit_Nm_ = machine.number("limits", "torque_Nm").value_or(0);
  if (auto done = watch.file_.open(file, live); !done) return done.error();
  return std::optional<OverrideWatch>{std::move(watch)};
}

OverrideWatch::OverrideWatch(const OverrideConfig& config, const StackPlan& plan,
                             const ChatterAdvice& advice, bool live)
    : config_(config),
      advice_(&advice),
      spindle_(plan.tool_spindle),
      sample_period_s_(config.sample_period_s),
      live_(live) {
  control_.configure(config);
}

void OverrideWatch::change(const StateChange<double>& change) {
  const bool alarm = change.state == MonitorState::alarm;
  if (change.monitor == MonitorId::chatter && change.channel == spindle_ && change.detail == 0)
    in_.chatter = alarm;
  if (change.monitor == MonitorId::torque_band) band_ = alarm;
  if (change.monitor == MonitorId::collision && !is_spindle(change.channel))
    collides_[axis_index(change.channel)] = alarm;
}

// Pockets are looked for when chatter begins, once a cut, beside the monitors.
void OverrideWatch::take_advice(double speed_rad_s) {
  const auto& s = control_.state();
  if (!in_.chatter && !in_.in_cut && s.phase == OverridePhase::programmed && !speeds_.valid()) {
    asked_ = false;
    in_.advised.fill(OverrideInput<double>::kUnknown);
  }
  if (in_.chatter && !asked_) {
    asked_ = true;
    programmed_rpm_ = rpm_from_rad_s(std::abs(speed_rad_s)) / s.speed_ratio;
    speeds_ = std::async(live_ ? std::launch::async : std::launch::deferred,
                         [advice = advice_, live = live_, rpm = programmed_rpm_, c = config_] {
                           if (live) leave_real_time();
                           return advice->advised_speeds(rpm, c.least_speed * rpm,
                                                         c.greatest_speed * rpm);
                         });
  }
  in_.advice_pending = speeds_.valid();
  if (!speeds_.valid() || speeds_.wait_for(std::chrono::seconds(0)) == std::future_status::timeout)
    return;
  AdvisedSpeeds found = speeds_.get();
  in_.advice_pending = false;
  clause_ = std::move(found.clause);
  // The faster one first: it costs no time, and pockets widen with the speed.
  std::reverse(found.rpm.begin(), found.rpm.end());
  for (std::size_t i = 0; i < std::min(found.rpm.size(), in_.advised.size()); ++i)
    in_.advised[i] = found.rpm[i] / programmed_rpm_;
}

void OverrideWatch::sample(double t_s, const MachineStack& stack, StopSink& stop, bool quiet) {
  const auto& cut = stack.first().cut().state();
  in_.in_cut = cut.cut == CutPresence::cutting;
  in_.collision = std::any_of(collides_.begin(), collides_.end(), [](bool c) { return c; });
  in_.load = torque_limit_Nm_ > 0 && !cut.unseen ? std::abs(cut.torque_Nm) / torque_limit_Nm_
                                                 : OverrideInput<double>::kUnknown;
  if (band_) in_.load = std::max(2.0, std::isfinite(in_.load) ? in_.load : 0.0);
  in_.feed_in_effect = stop.feed_in_effect();
  in_.taken_over = stop.taken_over();
  in_.resume = control_.state().hold && hold_ && !stop.active();
  take_advice(stack.drive(spindle_).sample.increment / sample_period_s_);
  const auto& s = control_.process(in_);
  if (s.hold && !hold_) stop.hold();
  stop.set(s.speed_ratio, s.feed_ratio);
  tell(t_s, quiet);
}

std::string OverrideWatch::reason() const {
  const auto& s = control_.state();
  if (s.hold && in_.collision) return "collision: feed hold";
  if (s.hold && s.exhausted)
    return "chatter: no stable speed is known inside the limits, and less feed has not ended it: "
           "feed hold";
  if (s.hold) return "overload: the least feed that is allowed is too much: feed hold";
  switch (s.phase) {
    case OverridePhase::advised:
      return "chatter: spindle to " + percent(s.target) + clause_;
    case OverridePhase::varying:
      return "chatter: the spindle speed varies by " + percent(config_.variation_amplitude) +
             clause_;
    case OverridePhase::reduced:
      return "chatter: no stable speed is known inside the limits, so the feed goes down to " +
             percent(config_.least_feed) + clause_;
    case OverridePhase::yielded:
      return "the operator has moved an override, and has it until this cut ends";
    case OverridePhase::programmed:
      break;
  }
  return s.overloaded ? "overload: less feed" : "back to what the program says";
}

void OverrideWatch::tell(double t_s, bool quiet) {
  const auto& s = control_.state();
  const bool step = s.phase != phase_ || s.hold != hold_ || s.overloaded != overloaded_;
  const bool home = s.speed_ratio == 1 && s.feed_ratio == 1;
  const bool moved = std::abs(s.speed_ratio - speed_) >= kTold ||
                     std::abs(s.feed_ratio - feed_) >= kTold ||
                     (home && (speed_ != 1 || feed_ != 1));
  if (!step && !moved) return;
  ++commands_;
  holds_ += s.hold && !hold_;
  steps_ += s.phase != phase_ && s.phase != OverridePhase::programmed;
  least_speed_ = std::min(least_speed_, s.speed_ratio);
  greatest_speed_ = std::max(greatest_speed_, s.speed_ratio);
  least_feed_ = std::min(least_feed_, s.feed_ratio);
  const std::string why = reason();
  char at[40];
  std::snprintf(at, sizeof at, "%.4f s: ", t_s);
  if (step && !quiet) note(at + why);
  phase_ = s.phase;
  hold_ = s.hold;
  overloaded_ = s.overloaded;
  speed_ = s.speed_ratio;
  feed_ = s.feed_ratio;
  file_.write_command(t_s, name_of(s.phase), s.speed_ratio, s.feed_ratio, s.hold, why);
}

std::string OverrideWatch::summary() const {
  const OverrideConfig& c = config_;
  char allowed[300];
  std::snprintf(
      allowed, sizeof allowed,
      "; allowed: spindle %.4g to %.4g %% and feed %.4g to %.4g %%, by %.4g and %.4g %% a "
      "second, variation %.4g %% at %.4g Hz, %.4g s a step, back %.4g s after the cut, "
      "feed per %s",
      100 * c.least_speed, 100 * c.greatest_speed, 100 * c.least_feed, 100 * c.greatest_feed,
      100 * c.speed_rate_per_s, 100 * c.feed_rate_per_s, 100 * c.variation_amplitude,
      c.variation_hz, c.patience_s, c.return_s, c.feed_per_minute ? "minute" : "turn");
  if (commands_ == 0) return std::string("overrides: nothing was commanded") + allowed;
  char text[240];
  std::snprintf(text, sizeof text,
                "overrides: %llu command(s) in %llu step(s); spindle %.0f to %.0f %%, feed down to "
                "%.0f %%, %llu feed hold(s)",
                static_cast<unsigned long long>(commands_), static_cast<unsigned long long>(steps_),
                100 * least_speed_, 100 * greatest_speed_, 100 * least_feed_,
                static_cast<unsigned long long>(holds_));
  return std::string(text) + allowed;
}

}  // namespace servosense::cli
