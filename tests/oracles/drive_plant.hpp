// Drives worked out from their equations of motion, independently of sim/ and model/: a closed-form
// reciprocating motion, a free two-mass axis, and a rigid axis under P-PI control. Fourth-order
// Runge-Kutta throughout.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <random>

namespace oracle {

constexpr double kPi = 3.14159265358979323846;

struct Motion {
  double x = 0, v = 0, a = 0;
};

/// To and fro over `distance` at `speed`, with dwells; the acceleration of each ramp is
/// A sin^2(pi t / ramp), so its own derivative is continuous. Closed form.
struct Reciprocating {
  double distance = 0.2;
  double speed = 0.8;
  double ramp_s = 0.08;
  double dwell_s = 0.05;

  [[nodiscard]] double stroke_s() const { return distance / speed + ramp_s; }
  [[nodiscard]] double cycle_s() const { return 2 * (stroke_s() + dwell_s); }
  [[nodiscard]] double peak_acceleration() const { return 2 * speed / ramp_s; }

  [[nodiscard]] Motion at(double t) const {
    t = std::fmod(t, cycle_s());
    const double half = cycle_s() / 2;
    if (t < half) return stroke(t);
    const Motion back = stroke(t - half);
    return {distance - back.x, -back.v, -back.a};
  }

 private:
  [[nodiscard]] Motion ramp(double t) const {
    const double peak = peak_acceleration(), w = 2 * kPi / ramp_s;
    return {peak * (t * t / 4 + (std::cos(w * t) - 1) / (2 * w * w)),
            peak * (t / 2 - std::sin(w * t) / (2 * w)), peak * (1 - std::cos(w * t)) / 2};
  }
  [[nodiscard]] Motion stroke(double t) const {
    if (t >= stroke_s()) return {distance, 0, 0};
    const double cruise_end = stroke_s() - ramp_s;
    if (t > cruise_end) {
      const Motion m = ramp(stroke_s() - t);
      return {distance - m.x, m.v, -m.a};
    }
    if (t < ramp_s) return ramp(t);
    return {speed * (t - ramp_s / 2), speed, 0};
  }
};

/// The elastic-plastic bristle of the friction, followed along a path.
struct Bristle {
  double knee = 5e-6, z = 0;
  double follow(double dx) { return (z = std::clamp(z + dx, -knee, knee)) / knee; }
};

template <std::size_t N, typename Derivative>
std::array<double, N> runge_kutta(const std::array<double, N>& y, double t, double h,
                                  Derivative&& f) {
  auto along = [&](const std::array<double, N>& k, double step) {
    std::array<double, N> p = y;
    for (std::size_t i = 0; i < N; ++i) p[i] += step * k[i];
    return p;
  };
  const auto k1 = f(t, y);
  const auto k2 = f(t + h / 2, along(k1, h / 2));
  const auto k3 = f(t + h / 2, along(k2, h / 2));
  const auto k4 = f(t + h, along(k3, h));
  std::array<double, N> next = y;
  for (std::size_t i = 0; i < N; ++i) next[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
  return next;
}

/// Motor side and stage joined by a spring (Koike 2016, eq. 2-12 to 2-14, in units of the stage).
struct TwoMassAxis {
  double motor_kg = 0, stage_kg = 0, stiffness_N_m = 0, damping_N_s_m = 0;
  std::array<double, 4> y{};  // motor x, v; stage x, v

  /// Frequency at which the two swing against each other.
  [[nodiscard]] double resonance_rad_s() const {
    return std::sqrt(stiffness_N_m * (1 / motor_kg + 1 / stage_kg));
  }
  void advance(double h, double effort_N, double cutting_N) {
    y = runge_kutta(y, 0, h, [&](double, const std::array<double, 4>& s) {
      const double spring = stiffness_N_m * (s[0] - s[2]) + damping_N_s_m * (s[1] - s[3]);
      return std::array<double, 4>{s[1], (effort_N - spring) / motor_kg, s[3],
                                   (spring - cutting_N) / stage_kg};
    });
  }
};

/// Rigid axis with viscous and bristle friction under P-PI control, seen through an encoder.
struct ServoAxis {
  double mass_kg = 227, viscous = 732, coulomb_N = 94, knee_m = 5e-6;
  double count_m = 0.016 / (1 << 20);
  double period_s = 125e-6;
  int current_every = 4;  ///< servo periods per current update
  double position_gain_per_s = 60, velocity_gain_N_s_m = 60e3, integral_per_s = 40;
  double force_noise_N = 0;  ///< rms of white noise on each current update, acting on the axis too
  unsigned seed = 1;

  struct Sample {
    std::int64_t counts = 0;
    double effort_N = 0;  ///< acting from this instant on
    double x = 0, v = 0;
  };

  /// One servo period: control on the encoder, then motion under `cutting(t, x)`.
  template <typename Cutting>
  Sample step(double reference_m, Cutting&& cutting) {
    if (n_ == 0) random_.seed(seed);
    Sample s;
    s.x = y_[0];
    s.v = y_[1];
    s.counts = static_cast<std::int64_t>(std::floor(y_[0] / count_m));
    const double x = static_cast<double>(s.counts) * count_m;
    if (n_ % current_every == 0) {
      const double over_s = current_every * period_s;
      const double e = position_gain_per_s * (reference_m - x) - (x - last_x_) / over_s;
      last_x_ = x;
      sum_ += velocity_gain_N_s_m * integral_per_s * over_s * e;
      effort_ = velocity_gain_N_s_m * e + sum_ + force_noise_N * normal_(random_);
    }
    s.effort_N = effort_;
    constexpr int kSteps = 5;
    const double h = period_s / kSteps;
    for (int k = 0; k < kSteps; ++k) {
      const double t = (static_cast<double>(n_) + static_cast<double>(k) / kSteps) * period_s;
      const double before = y_[0];
      y_ = runge_kutta(y_, t, h, [&](double at, const std::array<double, 2>& p) {
        const double z = std::clamp(bristle_.z + p[0] - before, -knee_m, knee_m) / knee_m;
        return std::array<double, 2>{
            p[1], (effort_ - viscous * p[1] - coulomb_N * z - cutting(at, p[0])) / mass_kg};
      });
      bristle_.knee = knee_m;
      bristle_.follow(y_[0] - before);
    }
    ++n_;
    return s;
  }

 private:
  std::array<double, 2> y_{};
  Bristle bristle_;
  double last_x_ = 0, sum_ = 0, effort_ = 0;
  std::int64_t n_ = 0;
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
};

}  // namespace oracle
