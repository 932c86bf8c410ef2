// A spindle whose torque constant falls beyond base speed and with current, worked out with an
// integrator, a friction law and a controller of its own: classical Runge and Kutta, a smooth sign,
// a velocity loop that holds its integral where the current is limited.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <string>

#include "servosense/core/units.hpp"

namespace oracle {

struct WeakenedSpindle {
  double inertia = 0.02, viscous = 1e-3, coulomb = 0.5,
         drag = 0;        ///< kg m2, Nm s/rad, Nm, Nm s2/rad2
  double constant = 0.8;  ///< Nm/A
  double base_rad_s = 300, exponent = 1;
  bool smooth = false;                  ///< kt / sqrt(1 + (w/base)^2) in place of a corner
  double knee_A = 1e9, share_lost = 0;  ///< beyond the knee an ampere gives that much less
  double soft_A = 1e9;                  ///< i / sqrt(1 + (i/soft)^2) in place of i
  double counts = 131072, noise_A = 0.02, limit_A = 20;
  double top_rad_s = 900;

  /// Log-uniform draws; run-ups of 150 to 500 rad/s2 below base speed.
  static WeakenedSpindle random(unsigned seed) {
    std::mt19937_64 bits(seed);
    const auto between = [&](double low, double high) {
      return low * std::pow(high / low, std::uniform_real_distribution<double>(0, 1)(bits));
    };
    WeakenedSpindle s;
    s.inertia = between(0.004, 0.08);
    s.viscous = s.inertia * between(0.01, 0.08);
    s.coulomb = s.inertia * between(10, 40);
    s.constant = between(0.3, 1.5);
    s.base_rad_s = between(150, 450);
    s.counts = std::pow(2.0, std::floor(between(16, 20.99)));
    const double run_up = between(150, 500) * s.inertia;
    s.limit_A = (run_up + s.coulomb + s.viscous * s.base_rad_s) / s.constant;
    s.noise_A = between(0.002, 0.01) * s.limit_A;
    s.top_rad_s = s.base_rad_s * between(2.7, 3.3);
    return s;
  }

  [[nodiscard]] double torque(double current, double w) const {
    const double size = std::abs(current), ratio = current / soft_A;
    const double lost = share_lost * std::fmax(0, size - knee_A);
    return torque_per_ampere(w) * std::copysign(size - lost, current) /
           std::sqrt(1 + ratio * ratio);
  }
  /// At low currents.
  [[nodiscard]] double torque_per_ampere(double w) const {
    const double ratio = std::abs(w) / base_rad_s;
    if (smooth) return constant / std::sqrt(1 + ratio * ratio);
    return ratio > 1 ? constant * std::pow(ratio, -exponent) : constant;
  }

  /// Rows `t_s,spindle.angle_counts,spindle.current_A` at 8 kHz under a speed reference and a load.
  void record(
      double duration_s, const std::function<double(double)>& speed_rad_s,
      const std::function<double(double)>& load_Nm, unsigned seed,
      const std::function<void(double t_s, std::int64_t counts, double current_A)>& row) const {
    std::mt19937_64 bits(seed);
    std::normal_distribution<double> noise(0, noise_A);
    run(duration_s, speed_rad_s, load_Nm,
        [&](double t, std::int64_t count, double current, double) {
          row(t, count, current + noise(bits));
        });
  }

  /// The same with the true current and speed.
  void run(double duration_s, const std::function<double(double)>& speed_rad_s,
           const std::function<double(double)>& load_Nm,
           const std::function<void(double t_s, std::int64_t counts, double current_A,
                                    double speed_rad_s)>& row) const {
    constexpr double kPeriod = 125e-6;
    constexpr int kSteps = 4;
    double angle = 0, w = 0, integral = 0;
    const double gain = inertia * 2 * servosense::kTwoPi * 10 / constant;
    const auto n = static_cast<long>(duration_s / kPeriod);
    for (long i = 0; i < n; ++i) {
      const double t = static_cast<double>(i) * kPeriod;
      const double error = speed_rad_s(t) - w;
      const double asked = gain * error + integral;
      const double current = std::fmin(limit_A, std::fmax(-limit_A, asked));
      if (current == asked) integral += gain * 20 * kPeriod * error;
      row(t, std::llround(std::floor(angle / servosense::kTwoPi * counts)), current, w);
      const auto rate = [&](double at) {
        return (torque(current, at) - viscous * at - drag * at * std::abs(at) -
                coulomb * std::tanh(at / 0.3) - load_Nm(t)) /
               inertia;
      };
      constexpr double h = kPeriod / kSteps;
      for (int k = 0; k < kSteps; ++k) {
        const double k1 = rate(w), k2 = rate(w + h / 2 * k1), k3 = rate(w + h / 2 * k2),
                     k4 = rate(w + h * k3);
        angle += h * (w + h / 6 * (k1 + k2 + k3));
        w += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
      }
    }
  }
};

}  // namespace oracle
