// A dynamometer under a milling force, for tests of its compensation: modes as second-order
// equations in displacement, classical Runge and Kutta of several steps a sample; the force of
// helical teeth summed over thin discs, each tooth with a radius of its own.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace oracle {

struct DynamometerSwing {
  double frequency_hz, damping, share;
};

struct HelicalCut {
  int teeth = 4, discs = 12;
  double radius_m = 0.008, helix_rad = 0.5235987755982988, depth_m = 0.002;
  double feed_m = 60e-6, tangential = 1040e6, edge = 9.81e3, radial_ratio = 0.3;
  double entry_rad = 0, exit_rad = 3.14159265358979323846;
  std::array<double, 8> throw_m{};  // of each tooth

  /// Force on the work in x where the spindle stands at `angle`.
  [[nodiscard]] double x(double angle) const {
    constexpr double kTurn = 6.283185307179586;
    const double disc_m = depth_m / discs;
    double sum = 0;
    for (int j = 0; j < teeth; ++j)
      for (int d = 0; d < discs; ++d) {
        double p = angle + kTurn * j / teeth - (d + 0.5) * disc_m * std::tan(helix_rad) / radius_m;
        p -= kTurn * std::floor(p / kTurn);
        if (p < entry_rad || p > exit_rad) continue;
        const std::size_t own = static_cast<std::size_t>(j);
        const std::size_t before = static_cast<std::size_t>((j + 1) % teeth);
        const double chip = feed_m * std::sin(p) + throw_m[own] - throw_m[before];
        if (chip <= 0) continue;
        const double tangential_N = (tangential * chip + edge) * disc_m;
        const double radial_N = (tangential * radial_ratio * chip + 0.5 * edge) * disc_m;
        sum += tangential_N * std::cos(p) + radial_N * std::sin(p);
      }
    return sum;
  }
};

/// A force over the spindle's angle, between the points of a table.
class ForceOverTurn {
 public:
  explicit ForceOverTurn(const HelicalCut& cut) {
    for (int i = 0; i <= kPoints; ++i) table_.push_back(cut.x(6.283185307179586 * i / kPoints));
  }
  [[nodiscard]] double at(double angle) const {
    const double turns = angle / 6.283185307179586;
    const double place = (turns - std::floor(turns)) * kPoints;
    const auto i = std::min(static_cast<std::size_t>(place), table_.size() - 2);
    const double part = place - static_cast<double>(i);
    return table_[i] + part * (table_[i + 1] - table_[i]);
  }

 private:
  static constexpr int kPoints = 7200;
  std::vector<double> table_;
};

class SwingingDynamometer {
 public:
  explicit SwingingDynamometer(std::vector<DynamometerSwing> modes)
      : modes_(std::move(modes)), x_(modes_.size()), v_(modes_.size()) {}

  /// What is reported at t + dt; force(t) acts meanwhile.
  template <typename Force>
  double advance(double t, double dt, Force&& force, int steps) {
    const double h = dt / steps;
    for (int i = 0; i < steps; ++i) {
      const double at = t + i * h;
      const double f0 = force(at), f1 = force(at + h / 2), f2 = force(at + h);
      for (std::size_t k = 0; k < modes_.size(); ++k) {
        const double w = 6.283185307179586 * modes_[k].frequency_hz;
        const auto a = [&](double x, double v, double f) {
          return w * w * (f - x) - 2 * modes_[k].damping * w * v;
        };
        const double x = x_[k], v = v_[k];
        const double a1 = a(x, v, f0), v1 = v;
        const double a2 = a(x + h / 2 * v1, v + h / 2 * a1, f1), v2 = v + h / 2 * a1;
        const double a3 = a(x + h / 2 * v2, v + h / 2 * a2, f1), v3 = v + h / 2 * a2;
        const double a4 = a(x + h * v3, v + h * a3, f2), v4 = v + h * a3;
        x_[k] = x + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
        v_[k] = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
      }
    }
    double reported = force(t + dt);
    for (std::size_t k = 0; k < modes_.size(); ++k)
      reported += modes_[k].share * (x_[k] - force(t + dt));
    return reported;
  }

 private:
  std::vector<DynamometerSwing> modes_;
  std::vector<double> x_, v_;
};

}  // namespace oracle
