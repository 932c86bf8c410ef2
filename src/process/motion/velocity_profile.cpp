#include "servosense/process/motion/velocity_profile.hpp"

#include <algorithm>
#include <cmath>

namespace servosense::process {
namespace {

/// Where a function that grows from `low` to `high` is `wanted`, or as little below as can be.
template <class Function>
double solve(double low, double high, double wanted, Function function) {
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (function(middle) < wanted ? low : high) = middle;
  }
  return low;
}

double phase_distance(const VelocityProfile::Phase& p, double t) {
  return t * (p.velocity_m_s + t * (p.acceleration_m_s2 / 2 + t * p.jerk_m_s3 / 6));
}
double phase_velocity(const VelocityProfile::Phase& p, double t) {
  return p.velocity_m_s + t * (p.acceleration_m_s2 + t * p.jerk_m_s3 / 2);
}

}  // namespace

double ramp_seconds(double from_m_s, double to_m_s, const RampLimits& limits) {
  const double dv = std::abs(to_m_s - from_m_s);
  const double a = limits.acceleration_m_s2, j = limits.jerk_m_s3;
  if (!(j < std::numeric_limits<double>::infinity())) return dv / a;
  return dv * j >= a * a ? dv / a + a / j : 2 * std::sqrt(dv / j);
}

double ramp_length(double from_m_s, double to_m_s, const RampLimits& limits) {
  return (from_m_s + to_m_s) / 2 * ramp_seconds(from_m_s, to_m_s, limits);
}

double reachable_speed(double end_m_s, double length_m, const RampLimits& limits) {
  const double a = limits.acceleration_m_s2, j = limits.jerk_m_s3;
  const double half = j < std::numeric_limits<double>::infinity() ? a * a / j / 2 : 0;
  const double ramped = end_m_s - half;
  const double fast = -half + std::sqrt(ramped * ramped + 2 * a * length_m);
  if (half == 0 || fast - end_m_s >= 2 * half) return fast;
  // dv = j x^2 in the time 2 x: j x^3 + 2 v x = length. Newton from above, where the cubic is
  // convex.
  double x = std::cbrt(length_m / j);
  if (end_m_s > 0) x = std::min(x, length_m / (2 * end_m_s));
  for (int i = 0; i < 20; ++i) {
    const double step = (x * (j * x * x + 2 * end_m_s) - length_m) / (3 * j * x * x + 2 * end_m_s);
    if (!(step > 1e-15 * x)) break;
    x -= step;
  }
  return end_m_s + j * x * x;
}

void VelocityProfile::add(const Phase& phase) {
  if (!(phase.duration_s > 0)) return;
  phases_[count_++] = phase;
  duration_s_ += phase.duration_s;
  length_m_ += phase_distance(phase, phase.duration_s);
}

void VelocityProfile::add_ramp(double from_m_s, double to_m_s, const RampLimits& limits) {
  const double sign = to_m_s < from_m_s ? -1 : 1;
  const double whole = ramp_seconds(from_m_s, to_m_s, limits);
  const double j = limits.jerk_m_s3;
  if (!(j < std::numeric_limits<double>::infinity())) {
    add({whole, from_m_s, sign * limits.acceleration_m_s2, 0});
    return;
  }
  const double jerked = std::min(limits.acceleration_m_s2 / j, whole / 2);
  const double a = sign * j * jerked;
  const double gained = a * jerked / 2;
  add({jerked, from_m_s, 0, sign * j});
  add({whole - 2 * jerked, from_m_s + gained, a, 0});
  add({jerked, to_m_s - gained, a, -sign * j});
}

VelocityProfile VelocityProfile::plan(double length_m, double start_m_s, double top_m_s,
                                      double end_m_s, const RampLimits& limits) {
  VelocityProfile profile;
  if (!(length_m > 0)) return profile;
  const auto ramp = [&](double from, double to) { return ramp_length(from, to, limits); };
  // Sums of squares and roots: a length is met to the last digits, no better.
  const double enough = length_m * (1 + 1e-9);
  if (ramp(start_m_s, end_m_s) > enough) {
    if (end_m_s > start_m_s) {
      profile.add_ramp(start_m_s, reachable_speed(start_m_s, length_m, limits), limits);
    } else {
      const double t = 2 * length_m / (start_m_s + end_m_s);
      profile.add({t, start_m_s, (end_m_s - start_m_s) / t, 0});
    }
    return profile;
  }
  double peak = top_m_s;
  if (ramp(start_m_s, peak) + ramp(peak, end_m_s) > enough) {
    const double low = std::max(start_m_s, end_m_s);
    if (top_m_s <= low) {
      peak = low;  // too fast and too near the end to slow down first
    } else if (limits.jerk_m_s3 < std::numeric_limits<double>::infinity()) {
      peak = solve(low, top_m_s, length_m,
                   [&](double v) { return ramp(start_m_s, v) + ramp(v, end_m_s); });
    } else {
      peak = std::sqrt(limits.acceleration_m_s2 * length_m +
                       (start_m_s * start_m_s + end_m_s * end_m_s) / 2);
    }
  }
  const double left = length_m - ramp(start_m_s, peak) - ramp(peak, end_m_s);
  profile.add_ramp(start_m_s, peak, limits);
  if (left > 0 && peak > 0) profile.add({left / peak, peak, 0, 0});
  profile.add_ramp(peak, end_m_s, limits);
  return profile;
}

double VelocityProfile::end_m_s() const {
  if (count_ == 0) return 0;
  const Phase& last = phases_[count_ - 1];
  return std::max(0.0, phase_velocity(last, last.duration_s));
}

double VelocityProfile::braking_from_m_s() const {
  double from = end_m_s();
  for (std::size_t i = count_; i-- > 0;) {
    const Phase& p = phases_[i];
    if (!(p.acceleration_m_s2 < 0 || p.jerk_m_s3 < 0)) break;
    if (p.acceleration_m_s2 > 0) break;  // the end of a ramp up
    from = p.velocity_m_s;
  }
  return from;
}

VelocityProfile::Place VelocityProfile::place(double t_s) const {
  static constexpr Phase kStands{};
  double before = 0;
  for (std::size_t i = 0; i < count_; ++i) {
    const Phase& p = phases_[i];
    if (t_s <= p.duration_s || i + 1 == count_)
      return {&p, std::clamp(t_s, 0.0, p.duration_s), before};
    t_s -= p.duration_s;
    before += phase_distance(p, p.duration_s);
  }
  return {&kStands, 0, 0};
}

double VelocityProfile::distance(double t_s) const {
  const Place at = place(t_s);
  return at.before_m + phase_distance(*at.phase, at.t_s);
}
double VelocityProfile::velocity(double t_s) const {
  const Place at = place(t_s);
  return phase_velocity(*at.phase, at.t_s);
}
double VelocityProfile::acceleration(double t_s) const {
  const Place at = place(t_s);
  return at.phase->acceleration_m_s2 + at.t_s * at.phase->jerk_m_s3;
}

double VelocityProfile::time_at(double distance_m) const {
  if (distance_m >= length_m_) return duration_s_;
  double t = 0;
  for (std::size_t i = 0; i < count_; ++i) {
    const Phase& p = phases_[i];
    const double whole = phase_distance(p, p.duration_s);
    if (distance_m <= whole)
      return t +
             solve(0, p.duration_s, distance_m, [&](double at) { return phase_distance(p, at); });
    distance_m -= whole;
    t += p.duration_s;
  }
  return duration_s_;
}

}  // namespace servosense::process
