#include "verdict.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "servosense/core/units.hpp"
#include "servosense/io/machine_keys.hpp"

namespace servosense::cli {
namespace {

// Conventions. Below 10 rpm nothing is milled, and a standing spindle swings by less.
constexpr double kTurning_rad_s = 1;
constexpr double kStretch_s = 0.1;
constexpr double kLeastArmed = 0.5;  // of the time that was due
constexpr double kMostFaulty = 0.1;  // likewise

bool of_cut(MonitorId monitor) { return monitor != MonitorId::signal; }

bool tells_of_drive(Quantity quantity) {
  switch (quantity) {
    case Quantity::angle_rad:
    case Quantity::angle_counts:
    case Quantity::speed_rad_s:
    case Quantity::position_m:
    case Quantity::velocity_m_s:
    case Quantity::current_A:
    case Quantity::torque_Nm:
    case Quantity::force_N:
    case Quantity::power_W:
    case Quantity::load_V:
    case Quantity::load_percent:
    case Quantity::torque_percent:
    case Quantity::current_percent:
      return true;
    default:
      return false;
  }
}

bool in_source(const std::vector<Signal>& signals, Channel channel) {
  return std::any_of(signals.begin(), signals.end(), [&](const Signal& s) {
    return s.channel == channel && tells_of_drive(s.quantity);
  });
}

std::string seconds(double value) {
  char text[32];
  std::snprintf(text, sizeof text, value < 1000 ? "%.3g" : "%.0f", value);
  return text;
}

std::string title(const MonitorAvailability& m) {
  return std::string(name_of(m.monitor)) +
         (m.channel == Channel::tool ? "" : " on " + std::string(name_of(m.channel)));
}

std::string listed(const std::vector<std::string>& parts) {
  std::string all;
  for (const std::string& part : parts) all += (all.empty() ? "" : ", ") + part;
  return all;
}

}  // namespace

WatchTally::WatchTally(const MachineFile& machine, const std::vector<Signal>& signals,
                       StackPlan& plan)
    : tool_spindle_(plan.tool_spindle) {
  for (const Channel channel : kDriveChannels) {
    const bool planned = std::ranges::any_of(
        plan.monitors, [&](const MonitorAvailability& m) { return m.channel == channel; });
    if (!planned && in_source(signals, channel))
      plan.monitors.push_back(
          {is_spindle(channel) ? MonitorId::chatter : MonitorId::collision, channel, false,
           "needs the drive's angle or speed and its current or torque", "no signals"});
    if (is_spindle(channel))
      spindles_.push_back({channel, plan.stack_of(channel).spindle.chatter.minimum_speed_rad_s});
  }
  for (const MonitorAvailability& m : plan.monitors) {
    Timeline line;
    line.monitor = m.monitor;
    line.channel = m.channel;
    const std::string section = monitor_section(m.monitor, m.channel);
    const bool there = is_drive(m.channel) ? in_source(signals, m.channel) ||
                                                 machine.has_section(section_of(m.channel))
                                           : machine.has_section(section);
    line.wanted = of_cut(m.monitor) && there && machine.flag(section, "enabled").value_or(true);
    if (m.monitor == MonitorId::signal) line.state = MonitorState::learning;
    lines_.push_back(line);
  }
}

Channel WatchTally::heard_on(Channel channel) const {
  return channel == Channel::tool || is_sensor(channel) ? tool_spindle_ : channel;
}

const WatchTally::Timeline* WatchTally::signal_of(Channel channel) const {
  for (const Timeline& line : lines_)
    if (line.monitor == MonitorId::signal && line.channel == heard_on(channel)) return &line;
  return nullptr;
}

void WatchTally::advance(Timeline& line, double t_s) const {
  const double passed = t_s - line.since_s;
  line.since_s = t_s;
  const Timeline* signal = signal_of(line.channel);
  // A drive that has told nothing but zeros may stand or be dead: nothing can be missed.
  const bool silent = signal != nullptr && signal->state == MonitorState::learning;
  if (line.state == MonitorState::idle || silent)
    line.idle_s += passed;
  else if (line.state == MonitorState::signal_fault || (signal != nullptr && !signal->sound))
    line.faulty_s += passed;
  else if (line.state != MonitorState::learning)
    line.armed_s += passed;
}

void WatchTally::change(const StateChange<double>& change, double t_s) {
  // What the signal's health says holds for all that hear it.
  for (Timeline& line : lines_)
    if (change.monitor == MonitorId::signal ? heard_on(line.channel) == change.channel
                                            : line.monitor == change.monitor)
      advance(line, t_s);
  for (Timeline& line : lines_)
    if (line.monitor == change.monitor && line.channel == change.channel) {
      line.state = change.state;
      const bool frozen = change.monitor == MonitorId::signal &&
                          change.detail == static_cast<std::uint8_t>(SignalCause::frozen_effort);
      line.sound = change.state != MonitorState::signal_fault &&
                   !(change.state == MonitorState::warning && frozen);
    }
}

WatchTally::Turning WatchTally::turning_of(Channel channel) const {
  for (const Turning& spindle : spindles_)
    if (spindle.channel == channel) return spindle;
  return {channel};
}

void WatchTally::sample(double t_s, const MachineStack& stack) {
  to_s_ = t_s;
  if (!started_) {
    started_ = true;
    from_s_ = stretch_from_s_ = t_s;
    for (Timeline& line : lines_) line.since_s = t_s;
  }
  const double passed = t_s - stretch_from_s_;
  if (passed < kStretch_s) return;
  stretch_from_s_ = t_s;
  for (Turning& spindle : spindles_) {
    const double at = stack.drive(spindle.channel).sample.position;
    const double speed = std::abs(at - spindle.stretch_from_rad) / passed;
    if (speed > kTurning_rad_s) spindle.turning_s += passed;
    spindle.fastest_rad_s = std::max(spindle.fastest_rad_s, speed);
    spindle.stretch_from_rad = at;
  }
}

std::string WatchTally::taught_so_far(MonitorId monitor, const StackPlan& plan,
                                      const MachineStack& stack) {
  const auto of = [](std::uint64_t heard, std::uint64_t asked, const char* what) {
    return heard == 0 ? std::string()
                      : "still being taught: " + std::to_string(heard) + " of " +
                            std::to_string(asked) + " " + what;
  };
  const auto* coefficients = stack.coefficients();
  const bool untaught = coefficients != nullptr && !(coefficients->state().taught_N_per_m2 > 0);
  const auto of_cut = [&] {
    return untaught
               ? of(coefficients->state().slots, plan.coefficients->teach_slots, "stretches of cut")
               : std::string();
  };
  if (monitor == MonitorId::cutting_coefficients) return of_cut();
  if (monitor != MonitorId::wear) return {};
  const WearConfig& wear = plan.config.tool.wear;
  const auto& tool = stack.first().tool().wear().tool();
  if (judges_holes(wear) && tool.taught > 0 && tool.taught < wear.teach_holes)
    return of(tool.taught, wear.teach_holes, "holes");
  return wear.specific_force_ratio > 0 ? of_cut() : std::string();
}

std::vector<Watched> WatchTally::finish(const StackPlan& plan, const MachineStack& stack,
                                        double sample_period_s) {
  const double end_s = to_s_ + sample_period_s;
  const double whole_s = started_ ? end_s - from_s_ : 0;
  std::vector<Watched> all;
  for (std::size_t i = 0; i < lines_.size(); ++i) {
    Timeline& line = lines_[i];
    if (started_) advance(line, end_s);
    const MonitorAvailability& m = plan.monitors[i];
    const Turning spindle = turning_of(heard_on(m.channel));
    Watched w;
    w.wanted = line.wanted;
    w.armed_s = line.armed_s;
    w.faulty_s = line.faulty_s;
    w.due_s = whole_s;
    if (m.monitor == MonitorId::chatter)
      w.due_s = std::max(line.armed_s + line.faulty_s, std::min(whole_s, spindle.turning_s));
    else
      w.due_s = whole_s - line.idle_s;
    // What the chatter monitor follows: from its least speed up to an eighth of a turn a sample.
    const double most_rad_s = kTwoPi / 8 / sample_period_s;
    const bool short_of_half = m.monitor == MonitorId::chatter && w.armed_s < kLeastArmed * w.due_s;
    if (!m.runs)
      w.why = m.obstacle;
    else if (short_of_half && spindle.fastest_rad_s < spindle.slowest_chatter_rad_s &&
             w.faulty_s <= 0)
      w.why = "the spindle stayed below " + seconds(rpm_from_rad_s(spindle.slowest_chatter_rad_s)) +
              " rpm";
    else if (short_of_half && spindle.fastest_rad_s > most_rad_s)
      w.why = "the spindle turned faster than " + seconds(rpm_from_rad_s(most_rad_s)) +
              " rpm, the most that this rate can follow";
    else if (std::string taught = taught_so_far(m.monitor, plan, stack);
             w.armed_s <= 0 && !taught.empty())
      w.why = std::move(taught);
    else if (w.faulty_s > kMostFaulty * w.due_s)
      w.why = "signal faulty for " + seconds(w.faulty_s) + " s";
    else if (w.due_s <= 0)
      w.why = m.monitor == MonitorId::chatter ? "the spindle stood"
              : m.channel == Channel::tool    ? "no cut of its kind"
                                              : "nothing but zeros";
    else if (w.armed_s < kLeastArmed * w.due_s)
      w.why = "of " + seconds(w.due_s) + " s";
    // Armed, but for what no cut reaches.
    if (m.runs && m.sees_from && m.sees_from->blind) {
      w.armed_s = 0;
      w.why = "deaf to any cut of the record";
    }
    all.push_back(std::move(w));
  }
  return all;
}

const char* name_of(VerdictWord word) noexcept {
  switch (word) {
    case VerdictWord::not_watched:
      return "not-watched";
    case VerdictWord::partly_watched:
      return "partly-watched";
    case VerdictWord::clear:
      return "clear";
    case VerdictWord::warning:
      return "warning";
    case VerdictWord::alarm:
      return "alarm";
  }
  return "";
}

Verdict verdict_of(const StackPlan& plan, const std::vector<Watched>& watched, std::uint64_t alarms,
                   std::uint64_t warnings, double duration_s) {
  Verdict v;
  std::vector<std::string> did, did_not;
  bool complete = true;
  for (std::size_t i = 0; i < watched.size(); ++i) {
    const MonitorAvailability& m = plan.monitors[i];
    const Watched& w = watched[i];
    if (!of_cut(m.monitor)) continue;
    if (w.wanted) ++v.wanted;
    if (w.armed_s > 0) {
      ++v.watched;
      did.push_back(title(m) + " for " + seconds(w.armed_s) + " s" +
                    (w.why.empty() ? "" : " (" + w.why + ")"));
    } else if (w.wanted && !w.why.empty()) {
      did_not.push_back(title(m) + " (" + w.why + ")");
    }
    // Where nothing was due, nothing was missed.
    if (w.wanted && !w.why.empty() && (!m.runs || w.due_s > 0)) complete = false;
  }
  v.word = alarms > 0       ? VerdictWord::alarm
           : v.watched == 0 ? VerdictWord::not_watched
           : warnings > 0   ? VerdictWord::warning
           : complete       ? VerdictWord::clear
                            : VerdictWord::partly_watched;
  v.sentence = v.watched == 0 ? "Nothing was watched"
                              : "Watched of " + seconds(duration_s) + " s: " + listed(did);
  if (!did_not.empty()) v.sentence += "; not watched: " + listed(did_not);
  v.sentence += ". " + std::to_string(alarms) + (alarms == 1 ? " alarm, " : " alarms, ") +
                std::to_string(warnings) + (warnings == 1 ? " warning." : " warnings.");
  return v;
}

}  // namespace servosense::cli
