// A drive that idles, from its equation of motion J x'' + D x' + C S(x) + L = effort - load, under
// a controller without sampling, so that effort and motion belong to the same instant. Fourth-order
// Runge-Kutta; knows nothing of model/, observer/ and sim/.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "oracles/drive_plant.hpp"

namespace oracle {

struct IdlePlant {
  double inertia = 227, viscous = 732, coulomb = 94, constant_load = 0, knee = 5e-6;
  double position_loop_rad_s = 200;  ///< natural frequency of the position loop; 0: speed loop only
  double speed_loop_rad_s = 400;

  struct Record {
    std::vector<double> x, effort;  ///< one per period
  };

  /// Follows `reference(t)`, a Motion, for `seconds`; `load(t)` opposes positive motion.
  template <typename Reference, typename Load>
  Record run(double seconds, double period_s, Reference&& reference, Load&& load) const {
    const auto n = static_cast<std::size_t>(seconds / period_s);
    Record record;
    record.x.reserve(n);
    record.effort.reserve(n);
    const double stiffness = inertia * position_loop_rad_s * position_loop_rad_s;
    const double damping = inertia * speed_loop_rad_s;
    const auto effort = [&](double t, double x, double v) {
      const Motion r = reference(t);
      return inertia * r.a + viscous * r.v + constant_load + stiffness * (r.x - x) +
             damping * (r.v - v);
    };
    const Motion start = reference(0);
    std::array<double, 2> y = {start.x, start.v};
    Bristle bristle{knee};
    constexpr int kSteps = 2;
    const double h = period_s / kSteps;
    for (std::size_t i = 0; i < n; ++i) {
      const double at = static_cast<double>(i) * period_s;
      record.x.push_back(y[0]);
      record.effort.push_back(effort(at, y[0], y[1]));
      for (int k = 0; k < kSteps; ++k) {
        const double from = y[0];
        y = runge_kutta(y, at + k * h, h, [&](double t, const std::array<double, 2>& p) {
          const double sign = std::clamp(bristle.z + p[0] - from, -knee, knee) / knee;
          return std::array<double, 2>{p[1], (effort(t, p[0], p[1]) - viscous * p[1] -
                                              coulomb * sign - constant_load - load(t)) /
                                                 inertia};
        });
        bristle.follow(y[0] - from);
      }
    }
    return record;
  }
  template <typename Reference>
  Record run(double seconds, double period_s, Reference&& reference) const {
    return run(seconds, period_s, reference, [](double) { return 0.0; });
  }
};

/// One motion after another, again and again.
struct FeedProgram {
  std::vector<Reciprocating> moves;

  [[nodiscard]] double cycle_s() const {
    double sum = 0;
    for (const Reciprocating& m : moves) sum += m.cycle_s();
    return sum;
  }
  [[nodiscard]] Motion at(double t) const {
    t = std::fmod(t, cycle_s());
    for (const Reciprocating& m : moves) {
      if (t < m.cycle_s()) return m.at(t);
      t -= m.cycle_s();
    }
    return moves.front().at(0);
  }
};

/// Speeds held in turn, with ramps v0 + dv (s - sin(2 pi s) / 2 pi) between them. Closed form.
struct SpeedProgram {
  double ramp_s = 0.3, hold_s = 0.5;
  std::vector<double> speeds;  ///< from the first, which is not held

  [[nodiscard]] double length_s() const {
    return static_cast<double>(speeds.size() - 1) * (ramp_s + hold_s);
  }
  [[nodiscard]] Motion at(double t) const {
    double x = 0;
    for (std::size_t i = 1; i < speeds.size(); ++i) {
      const double from = speeds[i - 1], rise = speeds[i] - from, w = 2 * kPi;
      if (t < ramp_s) {
        const double s = t / ramp_s;
        return {x + ramp_s * (from * s + rise * (s * s / 2 + (std::cos(w * s) - 1) / (w * w))),
                from + rise * (s - std::sin(w * s) / w), rise / ramp_s * (1 - std::cos(w * s))};
      }
      x += ramp_s * (from + rise / 2);
      t -= ramp_s;
      if (t < hold_s || i + 1 == speeds.size()) return {x + speeds[i] * t, speeds[i], 0};
      x += speeds[i] * hold_s;
      t -= hold_s;
    }
    return {x, speeds.back(), 0};
  }
};

/// What the drive reports of a record: counts from a random start, effort with white noise.
struct Reporter {
  double unit_per_count = 0.016 / (1 << 20);
  double noise_rms = 5;
  std::mt19937 random;
  double start = 0;
  std::normal_distribution<double> normal;

  Reporter(double count, double noise, unsigned seed)
      : unit_per_count(count), noise_rms(noise), random(seed) {
    start = std::uniform_real_distribution<double>(0, 1)(random);
  }
  [[nodiscard]] std::int64_t counts(double x) const {
    return static_cast<std::int64_t>(std::floor(x / unit_per_count + start));
  }
  double effort(double true_effort) { return true_effort + noise_rms * normal(random); }
};

}  // namespace oracle
