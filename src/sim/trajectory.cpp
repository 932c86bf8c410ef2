#include "servosense/sim/trajectory.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "servosense/core/units.hpp"

namespace servosense {

Expected<JerkLimitedMove> JerkLimitedMove::plan(double distance, const MotionLimits& limits) {
  const double v = limits.velocity;
  const double a = limits.acceleration;
  const double j = limits.jerk;
  for (const double limit : {v, a, j})
    if (!(limit > 0 && std::isfinite(limit)))
      return usage_error("limits of velocity, acceleration and jerk must be positive numbers");
  if (!std::isfinite(distance)) return usage_error("the distance of a move must be a number");

  JerkLimitedMove m;
  m.distance_ = distance;
  m.direction_ = distance < 0 ? -1 : 1;
  m.jerk_ = j;
  const double d = std::abs(distance);
  if (d == 0) return m;
  const double full = a * a / j;  // the least speed at which the acceleration limit is reached
  const auto time_to = [&](double speed) {
    return speed >= full ? speed / a + a / j : 2 * std::sqrt(speed / j);
  };
  double reached = v;
  if (d < v * time_to(v)) {
    // The root in the form that loses no digits when d is small.
    reached = 2 * a * d * j / (std::sqrt(a * a * a * a + 4 * a * d * j * j) + a * a);
    if (reached < full) reached = std::cbrt(d * d * j / 4);
  }
  m.velocity_ = std::min(reached, v);
  m.jerk_s_ = m.velocity_ >= full ? a / j : std::sqrt(m.velocity_ / j);
  m.acceleration_ = j * m.jerk_s_;
  m.ramp_s_ = time_to(m.velocity_);
  m.cruise_s_ = std::max(0.0, d / m.velocity_ - m.ramp_s_);
  return m;
}

// From rest to velocity_, forward.
MotionPoint JerkLimitedMove::ramp(double t) const {
  if (t <= jerk_s_) return {jerk_ * t * t * t / 6, jerk_ * t * t / 2, jerk_ * t, jerk_};
  const double left = ramp_s_ - t;
  if (left <= jerk_s_) {
    const double whole = velocity_ * ramp_s_ / 2;
    return {whole - velocity_ * left + jerk_ * left * left * left / 6,
            velocity_ - jerk_ * left * left / 2, jerk_ * left, -jerk_};
  }
  const double s = t - jerk_s_;
  const double v = jerk_ * jerk_s_ * jerk_s_ / 2;
  return {jerk_ * jerk_s_ * jerk_s_ * jerk_s_ / 6 + v * s + acceleration_ * s * s / 2,
          v + acceleration_ * s, acceleration_, 0};
}

MotionPoint JerkLimitedMove::at(double t_s) const {
  if (t_s <= 0) return {};
  const double left = duration_s() - t_s;
  if (left <= 0) return {distance_, 0, 0, 0};
  MotionPoint p;
  if (t_s < ramp_s_) {
    p = ramp(t_s);
  } else if (left < ramp_s_) {  // the way in, seen from the end
    p = ramp(left);
    p.position = std::abs(distance_) - p.position;
    p.acceleration = -p.acceleration;
  } else {
    p.position = velocity_ * (ramp_s_ / 2 + (t_s - ramp_s_));
    p.velocity = velocity_;
  }
  return {direction_ * p.position, direction_ * p.velocity, direction_ * p.acceleration,
          direction_ * p.jerk};
}

void Trajectory::add(Part part, double duration_s, double end) {
  part.from_s = duration_s_;
  part.start = end_;
  parts_.push_back(part);
  duration_s_ += duration_s;
  end_ = end;
}

Expected<Done> Trajectory::move_to(double target, const MotionLimits& limits) {
  const auto move = JerkLimitedMove::plan(target - end_, limits);
  if (!move) return move.error();
  Part part;
  part.move = *move;
  add(part, move->duration_s(), target);
  return Done{};
}

Expected<Done> Trajectory::dwell(double duration_s) {
  if (!(duration_s >= 0 && std::isfinite(duration_s)))
    return usage_error("a dwell needs a duration of zero or more seconds");
  add({}, duration_s, end_);
  return Done{};
}

Expected<Done> Trajectory::cruise(double velocity, double duration_s, const MotionLimits& limits) {
  const double speed = std::abs(velocity);
  if (!(speed > 0 && speed <= limits.velocity))
    return usage_error("a cruise needs a velocity other than zero and within its limit");
  if (!(duration_s >= 0 && std::isfinite(duration_s)))
    return usage_error("a cruise needs a duration of zero or more seconds");
  const MotionLimits at_speed{speed, limits.acceleration, limits.jerk};
  // Any move that is long enough reaches the speed; it tells how long the run-up takes.
  const auto probe =
      JerkLimitedMove::plan(2 * speed *
                                (speed / limits.acceleration + 2 * std::sqrt(speed / limits.jerk) +
                                 limits.acceleration / limits.jerk),
                            at_speed);
  if (!probe) return probe.error();
  const double distance = speed * (probe->ramp_s() + duration_s);
  return move_to(end_ + std::copysign(distance, velocity), at_speed);
}

Expected<Done> Trajectory::sine(double amplitude, double frequency_hz, unsigned cycles) {
  if (!(frequency_hz > 0 && std::isfinite(frequency_hz) && cycles > 0 && std::isfinite(amplitude)))
    return usage_error("a sine needs an amplitude, a frequency above zero and at least one cycle");
  Part part;
  part.amplitude = amplitude;
  part.frequency_rad_s = kTwoPi * frequency_hz;
  add(part, cycles / frequency_hz, end_);
  return Done{};
}

MotionPoint Trajectory::at(double t_s) const {
  if (!(t_s > 0) || parts_.empty()) return {start_, 0, 0, 0};
  if (t_s >= duration_s_) return {end_, 0, 0, 0};
  const auto after = std::upper_bound(parts_.begin(), parts_.end(), t_s,
                                      [](double t, const Part& p) { return t < p.from_s; });
  const Part& part = *std::prev(after);
  const double t = t_s - part.from_s;
  if (part.frequency_rad_s > 0) {
    const double w = part.frequency_rad_s;
    const double s = std::sin(w * t);
    const double c = std::cos(w * t);
    const double a = part.amplitude;
    return {part.start + a * (1 - c), a * w * s, a * w * w * c, -a * w * w * w * s};
  }
  MotionPoint p = part.move.at(t);
  p.position += part.start;
  return p;
}

}  // namespace servosense
