#include "servosense/io/unit_watch.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "servosense/core/plausible.hpp"

namespace servosense {
namespace {

constexpr std::size_t kStretchRows = 8;
constexpr double kStretch_s = 0.02;
constexpr std::size_t kLeast = 3, kLeastBrief = 5;
constexpr double kOddShare = 0.02, kOddShareBrief = 0.005;

std::string plain(double value) {
  char text[32];
  std::snprintf(text, sizeof text, value >= 1e4 && value < 1e7 ? "%.0f" : "%.4g", value);
  return text;
}

}  // namespace

UnitWatch::UnitWatch(Channel channel, const std::vector<Signal>& signals,
                     const DriveColumns& columns, const ColumnChoice& choice)
    : turns_(is_turning(channel)),
      section_(section_of(channel)),
      kind_(columns.signal.motion),
      effort_(column_name(signals[columns.effort_column])),
      scale_(kind_ == MotionKind::counts ? std::abs(choice.unit_per_count) : 1),
      max_speed_(choice.max_speed > 0 ? choice.max_speed
                 : turns_             ? kImpossibleSpeed_rad_s
                                      : kImpossibleVelocity_m_s),
      max_travel_(turns_ ? 0 : kImpossibleTravel_m),
      max_acceleration_(turns_ ? kImpossibleAcceleration_rad_s2 : kImpossibleAcceleration_m_s2),
      effort_kind_(columns.signal.effort),
      is_power_(columns.power.has_value()) {
  if (columns.constant_motion == 0) {
    quantity_ = signals[columns.motion_column].quantity;
    motion_ = column_name(signals[columns.motion_column]);
  }
  max_effort_ = effort_kind_ == EffortKind::current_A   ? kImpossibleCurrent_A
                : is_power_                             ? kImpossiblePower_W
                : effort_kind_ == EffortKind::torque_Nm ? kImpossibleTorque_Nm
                                                        : kImpossibleForce_N;
  // What another column stands for, or a current without a scale, has no unit to be wrong.
  if (choice.effort_is_ratio || !choice.effort.empty()) max_effort_ = 0;
  if (max_effort_ > 0 && effort_kind_ == EffortKind::current_A && choice.max_current_A > 0) {
    max_effort_ = 1.5 * choice.max_current_A;  // convention: overshoot, and a limit of the mean
    own_effort_limit_ = true;
  }
}

void UnitWatch::add(double t_s, std::optional<double> motion, std::optional<double> effort) {
  if (effort && std::isfinite(*effort)) {
    least_effort_ =
        efforts_heard_ == 0 ? std::abs(*effort) : std::min(least_effort_, std::abs(*effort));
    if (++efforts_heard_ == kStretchRows) {
      largest_effort_ = std::max(largest_effort_, least_effort_);
      efforts_heard_ = 0;
    }
  }
  ++rows_;
  if (!motion || !std::isfinite(*motion) || motion_.empty() || !(scale_ > 0)) {
    motion = motion_.empty() ? std::optional(0.0) : std::nullopt;
    if (!motion) return;
  }
  const double at = *motion * scale_;
  if (!started_) {
    started_ = true;
    from_s_ = t_s;
    from_ = low_ = high_ = at;
    rows_ = 0;
    return;
  }
  if (rows_ >= kStretchRows && t_s - from_s_ >= kStretch_s) end_stretch(t_s, at);
}

void UnitWatch::end_stretch(double t_s, double at) {
  const double passed = t_s - from_s_;
  const double speed = kind_ == MotionKind::velocity ? at : (at - from_) / passed;
  ++stretches_;
  // A wrong unit is as wrong in the next stretch; a wild reading comes back.
  const double before = has_speed_ ? speed_ : speed;
  const double slower = std::abs(speed) < std::abs(before) ? speed : before;
  const double lasting = speed * before > 0 ? slower : 0;
  speeds_.take(std::abs(lasting), max_speed_);
  if (has_speed_)
    accelerations_.take(std::abs(lasting - lasting_) / (0.5 * (passed + last_stretch_s_)),
                        max_acceleration_);
  if (max_effort_ > 0) efforts_.take(largest_effort_, max_effort_);
  if (kind_ != MotionKind::velocity && max_travel_ > 0) {
    low_ = std::min(low_, at);
    high_ = std::max(high_, at);
    travels_.take(high_ - low_, max_travel_);
  }
  has_speed_ = true;
  speed_ = speed;
  lasting_ = lasting;
  last_stretch_s_ = passed;
  from_s_ = t_s;
  from_ = at;
  rows_ = 0;
  largest_effort_ = 0;  // the eight values under way may go on into the next stretch
}

std::string UnitWatch::unit_of_motion() const {
  switch (quantity_) {
    case Quantity::angle_rad:
      return "looks like degrees";
    case Quantity::speed_rad_s:
      return "looks like rpm";
    case Quantity::position_m:
      return "looks like mm";
    case Quantity::velocity_m_s:
      return "looks like mm/s or mm/min";
    default:
      return turns_ ? "look at encoder_counts_per_rev"
                    : "look at encoder_counts_per_rev and lead_m";
  }
}

std::string UnitWatch::finding() const {
  std::string all;
  const auto say = [&](const std::string& what) { all += (all.empty() ? "" : "; ") + what; };
  const char* const speed_unit = turns_ ? " rpm" : " m/s";
  const double shown = turns_ ? 60 / kTwoPi : 1;
  if (speeds_.is_many(stretches_, kLeast, kOddShare))
    say(motion_ + " " + unit_of_motion() + ": it means " + plain(shown * speeds_.mean()) +
        speed_unit + ", beyond " + plain(shown * max_speed_) + speed_unit + " (if the machine " +
        "does that, write " + (turns_ ? "max_speed_rpm" : "max_velocity_m_s") + " in [" + section_ +
        "])");
  else if (travels_.is_many(stretches_, kLeast, kOddShare))
    say(motion_ + " " + unit_of_motion() + ": it means a travel of " + plain(high_ - low_) + " m");
  else if (accelerations_.is_many(stretches_, kLeastBrief, kOddShareBrief))
    say(motion_ + " " + unit_of_motion() + ": it means accelerations of " +
        plain(accelerations_.mean()) + (turns_ ? " rad/s2" : " m/s2"));
  if (efforts_.is_many(stretches_, kLeast, kOddShare)) {
    const char* unit = effort_kind_ == EffortKind::current_A   ? " A"
                       : is_power_                             ? " W"
                       : effort_kind_ == EffortKind::torque_Nm ? " Nm"
                                                               : " N";
    say(effort_ + " goes to " + plain(efforts_.mean()) + unit +
        (own_effort_limit_
             ? ", beyond the current_limit_A of its controller: looks like mA or percent"
             : ": looks like thousandths, or percent"));
  }
  return all;
}

Expected<Done> check_units(const Trace& trace, const ColumnChoices& choices,
                           const std::string& name) {
  if (trace.size() > 1)
    if (const RateFinding rate = check_rate(1 / trace.sample_rate_hz(), 0, choices.machine);
        !rate.sentence.empty())
      return data_error(name + ": " + rate.sentence);
  std::string all;
  for (const Channel channel : kDriveChannels) {
    ColumnChoice choice = choices.drive(channel);
    if (!choice.effort.empty() && !column_named(trace.signals, choice.effort)) choice.effort = "";
    const auto columns = drive_columns(trace.signals, channel, choice);
    // Counters that wrap are unwrapped where they are used.
    if (!columns || columns->signal.motion == MotionKind::counts) continue;
    UnitWatch watch(channel, trace.signals, *columns, choice);
    for (std::size_t i = 0; i < trace.size(); ++i) {
      std::optional<double> motion, effort;
      if (columns->constant_motion == 0 && trace.updated[columns->motion_column][i])
        motion = columns->motion_scale * trace.columns[columns->motion_column][i];
      if (trace.updated[columns->effort_column][i])
        effort = trace.columns[columns->effort_column][i];
      watch.add(trace.t_s[i], motion, effort);
    }
    if (const std::string finding = watch.finding(); !finding.empty())
      all += (all.empty() ? "" : "; ") + finding;
  }
  if (all.empty()) return Done{};
  return data_error(name + ": " + all + "; convert to the unit in the column's name");
}

RateFinding check_rate(double period_s, double stated_hz, const std::string& machine) {
  RateFinding found;
  const double rate = 1 / period_s;
  const bool differs = stated_hz > 0 && std::abs(rate - stated_hz) > kSameRate * stated_hz;
  if (!differs && period_s < kImpossiblePeriod_s) return found;
  // A clock in ms or us makes the rate wrong by a thousand or a million.
  const auto fits = [&](double seconds) {
    return stated_hz > 0 && std::abs(rate / seconds / stated_hz - 1) < kSameRate;
  };
  for (const double unit : {1e-3, 1e-6}) {
    // Rows that are too far apart are hardly in seconds, unless the machine file says so, too.
    const bool agreed = stated_hz > 0 && !differs;
    const bool likely = fits(unit) || (!agreed && !fits(1e-6) && period_s >= kImpossiblePeriod_s &&
                                       period_s * unit < kImpossiblePeriod_s);
    if (!likely) continue;
    found.seconds = unit;
    found.sentence = std::string("t_s looks like ") + (unit == 1e-3 ? "ms" : "us") +
                     ": its rows are " + plain(period_s) + " apart, which would be " + plain(rate) +
                     " Hz";
    if (stated_hz > 0 && !fits(unit))
      found.sentence += " (in s it would have " + plain(rate / unit) +
                        " Hz, not sample_rate_hz = " + plain(stated_hz) + " of " + machine + ")";
    return found;
  }
  if (differs)
    found.sentence = "its rows come at " + plain(rate) +
                     " Hz but sample_rate_hz = " + plain(stated_hz) + " in " + machine +
                     "; if its time is right, write its rate there and learn the thresholds anew "
                     "with 'servosense identify idle' on a record of that rate";
  else
    found.sentence = "its rows come at " + plain(rate) +
                     " Hz, too slow to tell anything of a drive; look at the unit of t_s";
  return found;
}

}  // namespace servosense
