// A drive as a shop has it, sampled and controlled: friction that falls with speed before it rises
// (Stribeck) and winds up bristles, with a ripple along the path; a current loop that lags behind
// what is reported; counts, steps of the current and jitter of the sampling. Its friction law
// (Stribeck's exponent, bristles that yield exponentially: Dahl 1968) is not the library's. Semi-
// implicit Euler; knows nothing of model/, observer/ and sim/.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "oracles/drive_plant.hpp"

namespace oracle {

struct ShopDrive {
  double inertia = 227, viscous = 732, coulomb = 94, constant_load = 0;
  double stribeck = 0;            ///< friction at rest above Coulomb's, as a part of it
  double stribeck_speed = 0.02;   ///< m/s or rad/s
  double stribeck_exponent = 1;   ///< exp(-(v / stribeck_speed)^exponent)
  double bristle = 3e-6;          ///< travel over which friction turns round [m or rad]
  double ripple = 0;              ///< of friction along the path, as a part of it
  double ripple_length = 0.005;   ///< m or rad
  double current_lag_s = 0;       ///< acting effort behind the reported one, first order
  double current_loop_rad_s = 0;  ///< the same, second order, damped by 0.7; 0 = none
  double position_gain_per_s = 60, speed_loop_rad_s = 300, integral_per_s = 40;
  double period_s = 125e-6;
  double count = 0.016 / (1 << 20);
  double effort_noise = 5;  ///< reported, rms
  double effort_step = 0;   ///< of the reported effort; 0 = none
  double jitter_s = 0;      ///< rms of the instant at which the encoder is read
  double stamp_step_s = 0;  ///< the encoder is read at ticks of a clock of so long; 0 = in time
  double effort_limit = 0;  ///< of what the controller may ask for; 0 = none

  struct Sample {
    std::int64_t counts = 0;
    double effort = 0;  ///< as reported
  };

  [[nodiscard]] double slip_friction(double x, double v) const {
    const double fall = std::exp(-std::pow(std::abs(v) / stribeck_speed, stribeck_exponent));
    const double along = 1 + ripple * std::sin(2 * kPi * x / ripple_length);
    return coulomb * (1 + stribeck * fall) * along;
  }

  [[nodiscard]] double at_tick(double t) const {
    return stamp_step_s > 0 ? stamp_step_s * std::round(t / stamp_step_s) : t;
  }

  /// Follows `reference(t)`, a Motion, for `seconds`; `load(t, x, v)` opposes positive motion.
  template <typename Reference, typename Load>
  std::vector<Sample> run(double seconds, unsigned seed, Reference&& reference, Load&& load) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    const double phase = std::uniform_real_distribution<double>(0, 1)(random);
    // Where the servo's instants lie between the ticks.
    const double tick = phase * stamp_step_s;
    const auto n = static_cast<std::size_t>(seconds / period_s);
    std::vector<Sample> out;
    out.reserve(n);
    constexpr int kSteps = 4;
    const double h = period_s / kSteps;
    double x = reference(0).x, v = reference(0).v, z = v > 0 ? 1 : 0, acting = 0, sum = 0;
    double acceleration = 0, rising = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const double t = static_cast<double>(i) * period_s;
      const Motion r = reference(t);
      const double late = jitter_s * normal(random) + at_tick(t + tick) - t - tick;
      const double read = x + v * late + 0.5 * acceleration * late * late;
      Sample s;
      s.counts = static_cast<std::int64_t>(std::floor(read / count + phase));
      // Cascade on position and speed, with feed forward, as controllers have it.
      const double error = position_gain_per_s * (r.x - x) + r.v - v;
      const double held = sum;
      sum += speed_loop_rad_s * integral_per_s * period_s * error;
      double command =
          inertia * (r.a + speed_loop_rad_s * error + sum) + effort_noise * 0.2 * normal(random);
      if (effort_limit > 0 && std::abs(command) > effort_limit) {
        command = std::copysign(effort_limit, command);
        sum = held;
      }
      s.effort = command + effort_noise * normal(random);
      if (effort_step > 0) s.effort = effort_step * std::round(s.effort / effort_step);
      out.push_back(s);
      for (int k = 0; k < kSteps; ++k) {
        if (current_loop_rad_s > 0) {
          const double w = current_loop_rad_s;
          rising += h * (w * w * (command - acting) - 1.4 * w * rising);
          acting += h * rising;
        } else if (current_lag_s > 0) {
          acting += (command - acting) * (1 - std::exp(-h / current_lag_s));
        } else {
          acting = command;
        }
        const double full = slip_friction(x, v);
        // Dahl (1968): the bristle yields towards the friction of sliding.
        const double moved = v * h;
        z += moved / bristle - z * std::abs(moved) / bristle;
        z = std::clamp(z, -1.0, 1.0);
        acceleration = (acting - full * z - viscous * v - constant_load - load(t, x, v)) / inertia;
        v += h * acceleration;
        x += h * v;
      }
    }
    return out;
  }
  template <typename Reference>
  std::vector<Sample> run(double seconds, unsigned seed, Reference&& reference) const {
    return run(seconds, seed, reference, [](double, double, double) { return 0.0; });
  }
};

}  // namespace oracle
