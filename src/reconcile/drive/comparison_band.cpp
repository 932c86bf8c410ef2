#include "reconcile/drive/comparison_band.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "reconcile/drive/limit_cycle.hpp"
#include "reconcile/drive/raw_columns.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/quantile.hpp"

namespace servosense::reconcile {
namespace {

constexpr double kMoving = 0.025;  // of the top speed: a slow encoder's steps are no noise

/// Standard deviation of the white part of a signal, from its fourth differences where it moves.
double white_noise(const Column& x, double moving) {
  std::vector<double> d;
  for (std::size_t i = 4; i < x.size(); ++i) {
    if (!(std::abs(x[i] - x[i - 4]) > moving)) continue;
    d.push_back(std::abs(x[i] - 4 * x[i - 1] + 6 * x[i - 2] - 4 * x[i - 3] + x[i - 4]));
  }
  if (d.size() < 100) return 0;
  return median(std::move(d)) / 0.6745 / std::sqrt(70.0);
}

/// Differences of a motion in few and even steps are mostly equal, and tell less.
double noise_of_steps(const DriveData& data) {
  return std::max(std::abs(data.unit_per_count), data.motion_step) / std::sqrt(12.0);
}

struct Noise {
  double position = 0, effort = 0;
  LimitCycle limit_cycle;
};

/// Of the samples. A drive that swings shows no white noise in its differences.
Noise noise_of(const DriveData& data, const Criteria& criteria) {
  const Column position = raw_position(data);
  const Column effort = raw_effort(data);
  double fastest = 0;
  for (const auto& sample : data.samples) fastest = std::max(fastest, std::abs(sample.increment));
  const LimitCycle limit_cycle = find_limit_cycle(data, criteria);
  if (!(limit_cycle.frequency_hz > 0))
    return {white_noise(position, kMoving * 4 * fastest), white_noise(effort, 0), limit_cycle};
  return {noise_beside_limit_cycle(position, data.sample_period_s, kMoving * fastest),
          noise_beside_limit_cycle(effort, data.sample_period_s, 0), limit_cycle};
}

/// What the encoder's noise, white, does to the force of inertia through the filter: the integral
/// of u^4 2^-u^2 over positive u is 1.66.
double force_of_position_noise(const DriveData& data, double position_noise, double corner) {
  return data.model.inertia * kTwoPi * kTwoPi * position_noise *
         std::sqrt(2 * data.sample_period_s * 1.66 * std::pow(corner, 5));
}

/// What is left of a swing behind the filter, rms, if the mass that swings were the whole: about
/// the error of any model there.
double force_of_swing(const DriveData& data, const LimitCycle& limit_cycle, double corner) {
  const double speed = kTwoPi * limit_cycle.frequency_hz, ratio = limit_cycle.frequency_hz / corner;
  return data.model.inertia * speed * speed * limit_cycle.amplitude * std::sqrt(0.5) *
         std::exp2(-0.5 * ratio * ratio);
}

}  // namespace

double comparison_corner(const DriveData& data, const Criteria& criteria) {
  const std::size_t n = data.samples.size();
  double square = 0;
  for (const auto& sample : data.samples) square += sample.effort * sample.effort;
  const double effort_rms = std::sqrt(square / static_cast<double>(std::max<std::size_t>(1, n)));
  const Noise noise = noise_of(data, criteria);
  const double position_noise = std::max(noise_of_steps(data), noise.position);
  const double highest = std::min(criteria.highest_corner_hz, 0.1 / data.sample_period_s);
  for (double corner = highest; corner > criteria.lowest_corner_hz; corner *= 0.9) {
    // Through the Gaussian: the integral of 2^-u^2 over positive u.
    const double force = noise.effort * std::sqrt(2 * data.sample_period_s * 1.0645 * corner);
    if (force_of_position_noise(data, position_noise, corner) +
            force_of_swing(data, noise.limit_cycle, corner) <
        std::max(0.5 * force, criteria.tolerable_noise * effort_rms))
      return corner;
  }
  return std::min(highest, criteria.lowest_corner_hz);
}

double encoder_floor(const DriveData& data, double corner, const Criteria& criteria) {
  double noise = noise_of_steps(data);
  if (0.1 / data.sample_period_s >= criteria.highest_corner_hz)
    noise = std::max(noise,
                     noise_of(data, criteria).position);  // slower rows would take motion for noise
  return force_of_position_noise(data, noise, corner);
}

}  // namespace servosense::reconcile
