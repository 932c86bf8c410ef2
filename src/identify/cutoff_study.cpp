#include "servosense/identify/cutoff_study.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include "servosense/dsp/first_order.hpp"
#include "servosense/dsp/notch.hpp"

namespace servosense {
namespace {

// What the sampling structure of the source's control puts on the estimate (Koike 2016, sec. 5.2).
constexpr std::array kNotches_hz = {1000.0, 2000.0};

/// Force and force rate of one record at one cutoff, as the source hears them: notches, and the
/// mean of two samples.
class RateObserver {
 public:
  RateObserver(DisturbanceObserverConfig c, double cutoff_rad_s) {
    c.disturbance_cutoff_rad_s = c.velocity_cutoff_rad_s = cutoff_rad_s;
    force_.configure(c);
    rate_.configure({cutoff_rad_s, c.sample_period_s, c.discretisation});
    for (std::size_t i = 0; i < notch_.size(); ++i) {
      used_[i] = kNotches_hz[i] * c.sample_period_s < 0.45;
      if (used_[i]) notch_[i].configure({kNotches_hz[i], 2, c.sample_period_s});
    }
  }
  /// {force, force rate}
  std::pair<double, double> process(const DriveSample<double>& in) {
    const double force = force_.process(in);
    double rate = rate_.process(begun_ ? force - force_before_ : 0);
    force_before_ = force;
    begun_ = true;
    for (std::size_t i = 0; i < notch_.size(); ++i)
      if (used_[i]) rate = notch_[i].process(rate);
    const double mean = (rate + rate_before_) / 2;
    rate_before_ = rate;
    return {force, mean};
  }

 private:
  DisturbanceObserver<double> force_;
  PseudoDerivative<double> rate_;
  std::array<Notch<double>, 2> notch_;
  std::array<bool, 2> used_{};
  double force_before_ = 0, rate_before_ = 0;
  bool begun_ = false;
};

}  // namespace

CutoffPoint study_cutoff(const DisturbanceObserverConfig& base,
                         std::span<const DriveSample<double>> idle, const Contact& contact,
                         double cutoff_rad_s) {
  CutoffPoint point;
  point.cutoff_rad_s = cutoff_rad_s;
  const double period = base.sample_period_s;
  const auto settled = static_cast<std::size_t>(30 / (cutoff_rad_s * period)) + 2;
  RateObserver observer(base, cutoff_rad_s);
  std::vector<double> forces;
  for (std::size_t i = 0; i < idle.size(); ++i) {
    const auto [force, rate] = observer.process(idle[i]);
    if (i < settled) continue;
    forces.push_back(force);
    point.idle_rate = std::max(point.idle_rate, std::abs(rate));
  }
  // About a moving average of 50 ms (Koike 2016, sec. 5.2).
  const auto half = static_cast<std::size_t>(0.025 / period);
  double sum = 0, square = 0, count = 0;
  for (std::size_t i = 0; i < forces.size(); ++i) {
    sum += forces[i];
    if (i > 2 * half) sum -= forces[i - 2 * half - 1];
    if (i < 2 * half) continue;
    const double off = forces[i - half] - sum / static_cast<double>(2 * half + 1);
    square += off * off;
    ++count;
  }
  if (count > 0) point.idle_force = std::sqrt(square / count);

  // At rest the drive answers to the force alone, which the motor carries.
  DisturbanceObserverConfig bare = base;
  bare.drive.viscous = bare.drive.coulomb = bare.drive.constant_load = 0;
  bare.drive.effects.count = 0;
  RateObserver alone(bare, cutoff_rad_s);
  DriveSample<double> sample;
  for (int i = 0; i < 3; ++i) alone.process(sample);
  point.seen_after_s = std::numeric_limits<double>::infinity();
  const double until = contact.duration_s + 10 / cutoff_rad_s;
  for (double t = period; t < until; t += period) {
    sample.effort = t <= contact.duration_s ? contact.rate * t : 0;
    const double rate = alone.process(sample).second;
    // The fall afterwards is another event.
    if (t > contact.duration_s) break;
    point.contact_rate = std::max(point.contact_rate, rate);
    if (rate > point.idle_rate && t < point.seen_after_s) point.seen_after_s = t;
  }
  return point;
}

StudiedAxis studied_axis(double mass_error, double position_noise_m, double duration_s,
                         unsigned long seed) {
  constexpr double kMass = 227, kViscous = 732, kCoulomb = 94, kAcceleration = 10;
  constexpr double kSpeed = 50.0 / 60, kCount = 0.016 / 1048576, kDwell_s = 0.4;
  StudiedAxis axis;
  axis.model.drive.inertia = kMass;
  axis.model.drive.viscous = kViscous;
  axis.model.drive.coulomb = kCoulomb;
  axis.model.drive.friction_knee = 5e-6;
  const double period = axis.model.sample_period_s;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise(0, position_noise_m);
  double x = 0, v = 0, reported = 0, target = kSpeed, dwelt = 0;
  const auto count = static_cast<std::size_t>(duration_s / period);
  for (std::size_t i = 0; i < count; ++i) {
    const double step = std::clamp(target - v, -kAcceleration * period, kAcceleration * period);
    const double next = v + step;
    x += period * (v + next) / 2;
    v = next;
    dwelt = step == 0 ? dwelt + period : 0;
    if (dwelt > kDwell_s) {
      target = target > 0 ? -kSpeed : kSpeed;
      dwelt = 0;
    }
    DriveSample<double> s;
    const double now = kCount * std::floor((x + noise(random)) / kCount);
    s.increment = now - reported;
    s.position = now;
    reported = now;
    s.effort = kMass * (1 + mass_error) * step / period + kViscous * v +
               (v == 0 ? 0 : std::copysign(kCoulomb, v));
    axis.idle.push_back(s);
  }
  return axis;
}

}  // namespace servosense
