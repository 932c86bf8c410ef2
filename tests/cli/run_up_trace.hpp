// A spindle that runs up and sweeps through one mode: a trace, the mode integrated in time.
#pragma once

#include <cmath>
#include <cstdio>
#include <random>
#include <string>

namespace run_up_test {

constexpr double kModeHz = 60;
constexpr double kModeDamping = 0.03;

/// From 20 to 90 turns a second in `up_s`, at 1000 samples a second; order 1 is unbalance.
inline std::string trace(double up_s = 5, bool swings = true) {
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal(0, 1);
  constexpr int kSub = 50;
  constexpr double kStep_s = 1e-3 / kSub;
  const double w = 2 * M_PI * kModeHz;
  double x = 0, v = 0;
  std::string text = "t_s,tool.acceleration_x_m_s2,spindle.angle_rad\n";
  for (int i = 0; i < static_cast<int>(1000 * up_s); ++i) {
    double a = 0, angle = 0;
    for (int sub = 0; sub < kSub; ++sub) {  // the velocity first, then the way
      const double t = i * 1e-3 + sub * kStep_s, speed = 20 + 70 * t / up_s;
      const double turn = 2 * M_PI * (20 * t + 35 * t * t / up_s);
      const double now = speed * speed * std::cos(turn) - 2 * kModeDamping * w * v - w * w * x;
      v += kStep_s * now, x += kStep_s * v;
      if (sub == 0) a = now, angle = turn;
    }
    char row[96];
    std::snprintf(row, sizeof row, "%.3f,%.4f,%.6f\n", i * 1e-3,
                  (swings ? a : 0) + 500 * normal(random), angle);
    text += row;
  }
  return text;
}

}  // namespace run_up_test
