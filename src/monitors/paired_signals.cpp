#include "servosense/monitors/paired_signals.hpp"

#include <algorithm>

namespace servosense {
namespace {

constexpr double kHole = 5;       // usual steps of time
constexpr double kRests_s = 0.1;  // without a step of the command: the drive stands at it
constexpr double kFull = 0.98;    // of the limit of the effort
constexpr double kCloses = 0.8;   // of what is allowed: the end of an alarm
constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();

}  // namespace

PairReader::PairReader(const PairedColumns& columns, const PairScaling& scaling)
    : columns_(columns), unit_per_turn_(scaling.unit_per_turn) {
  const DriveColumns& drive = columns.drive;
  const bool counts = drive.signal.motion == MotionKind::counts;
  const double along = counts ? scaling.unit_per_count : drive.motion_scale;
  const Travel way(drive.is_angle ? Reading::angle
                   : counts       ? Reading::counts
                                  : Reading::plain,
                   scaling.counter_bits);
  const Travel turning(is_turning(columns.channel) ? Reading::angle : Reading::plain);
  column_ = {drive.motion_column,   drive.effort_column, columns.load, columns.second_motion,
             columns.second_effort, columns.following,   std::nullopt};
  if (columns.command) column_[command] = columns.command->column;
  scale_ = {along, scaling.effort_per_unit, 1, along, scaling.effort_per_unit,
            1,     scaling.command_per_unit};
  travel_ = {way,     Travel(), turning,
             way,     Travel(), columns.following_is_error ? Travel() : turning,
             Travel()};
  is_count_[motion] = is_count_[second_motion] = counts;
  if (columns.following_is_error) zero_ = 0;
  sign_.configure(scaling.knee);
}

double PairReader::turn_wave(std::size_t n) const {
  if (!(unit_per_turn_ > 0)) return 0;
  const double phase = (n < 2 ? 1 : 2) * kTwoPi * value_[motion] / unit_per_turn_;
  return n % 2 == 0 ? std::sin(phase) : std::cos(phase);
}

void PairReader::restart(double t_s) {
  started_ = true;
  from_s_ = t_s;
  for (std::size_t i = 0; i < kInputs; ++i) filtered_[i].reset(value_[i]);
  direction_.reset(0);
  for (std::size_t n = 0; n < turn_.size(); ++n) turn_[n].reset(turn_wave(n));
  sign_.reset();
  last_motion_ = value_[motion];
  resting_from_s_ = t_s;
  resting_at_ = value_[motion];
  resting_command_ = value_[following];
}

void PairReader::find_zero(double t_s) {
  if (zero_ || !column_[following] || !known_[following]) return;
  if (value_[following] != resting_command_) {
    resting_command_ = value_[following];
    resting_from_s_ = t_s;
  }
  const double actual = value_[column_[load] ? load : motion];
  if (t_s - resting_from_s_ >= kRests_s && std::abs(filtered_[motion].rate()) < 1e-5)
    zero_ = value_[following] - actual;
}

double PairReader::difference(PairKind kind) const {
  const auto low = [&](Input input) { return filtered_[input].low(); };
  const auto there = [&](Input input) { return column_[input] && known_[input]; };
  switch (kind) {
    case PairKind::load:
      return there(load) ? low(load) - low(motion) : kNoNumber;
    case PairKind::skew:
      return there(second_motion) ? low(motion) - low(second_motion) : kNoNumber;
    case PairKind::skew_effort:
      return there(second_effort) ? low(effort) - low(second_effort) : kNoNumber;
    case PairKind::following:
      if (!there(following) || !zero_) return kNoNumber;
      if (columns_.following_is_error) return low(following);
      return low(following) - low(there(load) ? load : motion) - *zero_;
    case PairKind::command:
      return there(command) ? low(effort) - low(command) : kNoNumber;
  }
  return kNoNumber;
}

bool PairReader::hear(const TraceRow& row) {
  if (row.fields.empty()) return false;
  const double t_s = seconds_from(row.t_ns);
  bool sound = true;
  for (std::size_t i = 0; i < kInputs; ++i) {
    if (!column_[i]) continue;
    const TraceField& field = row.fields[*column_[i]];
    if (field.state == TraceField::State::invalid) sound = false;
    if (field.state != TraceField::State::value) continue;
    const double way = travel_[i].add(field);
    // A counter that has been to its home says where the drive is.
    if (is_count_[i] && !known_[i]) base_[i] = scale_[i] * field.value;
    value_[i] = base_[i] + scale_[i] * way;
    known_[i] = true;
  }
  const double dt = t_s - sample_.t_s;
  const bool hole = started_ && typical_s_ > 0 && dt > kHole * typical_s_;
  sample_.t_s = t_s;
  sample_.settled = false;
  if (!known_[motion] || !known_[effort]) return false;
  if (!started_ || hole || !sound || !(dt > 0)) {
    restart(t_s);
    return false;
  }
  typical_s_ = typical_s_ > 0 ? typical_s_ + (dt - typical_s_) / 64 : dt;
  const double half_step = kCutoff_rad_s * dt / 2;
  for (std::size_t i = 0; i < kInputs; ++i)
    if (column_[i]) filtered_[i].process(value_[i], half_step, kCutoff_rad_s);
  direction_.process(sign_.process(value_[motion] - last_motion_), half_step, kCutoff_rad_s);
  last_motion_ = value_[motion];
  if (unit_per_turn_ > 0)
    for (std::size_t n = 0; n < turn_.size(); ++n) {
      turn_[n].process(turn_wave(n), half_step, kCutoff_rad_s);
      sample_.turn[n] = turn_[n].low();
    }
  find_zero(t_s);
  sample_.settled = t_s - from_s_ > kSettle_s;
  sample_.position = filtered_[motion].low();
  sample_.velocity = filtered_[motion].rate();
  sample_.acceleration = filtered_[motion].curvature();
  sample_.direction = direction_.low();
  sample_.raw_effort = value_[effort];
  sample_.effort =
      filtered_[effort].low() + (column_[second_effort] ? filtered_[second_effort].low() : 0.0);
  sample_.command_rate = column_[command] ? filtered_[command].rate() : 0;
  sample_.command_curvature = column_[command] ? filtered_[command].curvature() : 0;
  for (std::size_t k = 0; k < kPairKinds; ++k)
    sample_.difference[k] = difference(static_cast<PairKind>(k));
  return true;
}

std::array<double, 4> PairTerms::polynomials(double at) const {
  if (!(high > low)) return {};
  const double s = std::clamp((2 * at - low - high) / (high - low), -1.0, 1.0), s2 = s * s;
  return {(3 * s2 - 1) / 2, s * (5 * s2 - 3) / 2, (s2 * (35 * s2 - 30) + 3) / 8,
          s * (s2 * (63 * s2 - 70) + 15) / 8};
}

double PairTerms::at(const PairSample& s) const {
  double sum = zero + position * s.position + velocity * s.velocity +
               acceleration * s.acceleration + direction * s.direction + effort * s.effort +
               command_rate * s.command_rate;
  const auto p = polynomials(s.position);
  for (std::size_t i = 0; i < p.size(); ++i) sum += curve[i] * p[i];
  return sum;
}

std::vector<double> PairTerms::list() const {
  std::vector<double> all = {zero,      position, velocity,    acceleration,
                             direction, effort,   command_rate};
  if (high > low) {
    all.insert(all.end(), {low, high});
    all.insert(all.end(), curve.begin(), curve.end());
  }
  return all;
}

std::optional<PairTerms> PairTerms::from(const std::vector<double>& list) {
  if (list.size() != kPlain && list.size() != kCurved) return std::nullopt;
  PairTerms t{list[0], list[1], list[2], list[3], list[4], list[5], list[6]};
  if (list.size() == kPlain) return t;
  t.low = list[7];
  t.high = list[8];
  std::copy_n(list.begin() + 9, t.curve.size(), t.curve.begin());
  return t;
}

void PairWatch::judge(double dt, bool in_air) {
  const double coulomb = std::abs(config_.idle_effort.direction);
  const double pushed = std::abs(disturbance_);
  const double scaled = coulomb > 0 ? config_.band * pushed / (2 * coulomb) : 0;
  double slack = 0;
  switch (config_.kind) {
    case PairKind::load:
      slack = std::abs(config_.terms.effort) * pushed;
      break;
    case PairKind::skew:
    case PairKind::following:
      slack = scaled;
      break;
    case PairKind::skew_effort:
      slack = in_air ? 0 : pushed;
      break;
    case PairKind::command:
      break;
  }
  if (!wanders()) {
    value_ = std::abs(residual_);
    allowed_ = config_.band + slack;
    return;
  }
  low_ += (residual_ - low_) * dt / kForget_s;
  high_ += (residual_ - high_) * dt / kForget_s;
  const double low = std::min(low_, residual_ + slack);
  const double high = std::max(high_, residual_ - slack);
  value_ = high - low;
  allowed_ = config_.band;
  // What is too far is no part of the wandering: it is over, or it is told of.
  if (value_ > allowed_) return;
  low_ = low;
  high_ = high;
}

PairWatch::Change PairWatch::process(const PairSample& s, bool in_air) {
  const double difference = s.difference[static_cast<std::size_t>(config_.kind)];
  if (!s.settled || !std::isfinite(difference)) {
    // Behind a hole a counter may have another zero.
    started_ = started_ && s.settled;
    beyond_s_ = 0;
    return Change::none;
  }
  if (config_.effort_limit > 0 && std::abs(s.raw_effort) >= kFull * config_.effort_limit)
    saturated_s_ = s.t_s;
  residual_ = difference - config_.terms.at(s);
  disturbance_ = s.effort - config_.idle_effort.at(s);
  const double dt = started_ ? s.t_s - last_t_s_ : 0;
  last_t_s_ = s.t_s;
  if (!started_) low_ = high_ = residual_;
  started_ = true;
  watched_s_ += dt;
  judge(dt, in_air);
  largest_ = std::max(largest_, value_);
  if (!is_beyond_) {
    beyond_s_ = value_ > allowed_ ? beyond_s_ + dt : 0;
    if (beyond_s_ < kHold_s) return Change::none;
    is_beyond_ = true;
    within_s_ = 0;
    // From here on, so that the next slip is seen as well.
    if (wanders()) low_ = high_ = residual_;
    return Change::beyond;
  }
  within_s_ = value_ <= kCloses * allowed_ ? within_s_ + dt : 0;
  if (within_s_ < kRelease_s) return Change::none;
  is_beyond_ = false;
  beyond_s_ = 0;
  return Change::within;
}

}  // namespace servosense
