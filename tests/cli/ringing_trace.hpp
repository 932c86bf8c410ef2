// Cuts that end in the air, where two modes ring: a trace, by the closed form.
#pragma once

#include <cmath>
#include <cstdio>
#include <random>
#include <string>

namespace ringing_test {

constexpr double kFrequencyHz[] = {415, 850};
constexpr double kDamping[] = {0.03, 0.02};

/// Two cuts of 0.3 s with 0.5 s of air, at 5000 samples a second and 30 turns a second.
inline std::string trace(bool rings = true, bool with_speed = true) {
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal(0, 0.05);
  std::string text =
      with_speed ? "t_s,dyno.force_x_N,spindle.speed_rad_s\n" : "t_s,dyno.force_x_N\n";
  for (int i = 0; i < 8000; ++i) {
    const double all_s = i / 5000., t = std::fmod(all_s, 0.8) - 0.3, turn = 2 * M_PI * 30 * all_s;
    double y = normal(random) + 0.2 * std::cos(turn);
    if (t < 0)
      y += 20 + 6 * std::cos(4 * turn) + 3 * std::cos(8 * turn + 1);
    else if (rings)
      for (int m = 0; m < 2; ++m) {
        const double w = 2 * M_PI * kFrequencyHz[m], z = kDamping[m];
        y += (4 - m) * std::exp(-z * w * t) * std::cos(w * std::sqrt(1 - z * z) * t + m);
      }
    char row[80];
    std::snprintf(row, sizeof row, with_speed ? "%.4f,%.6f,188.495559\n" : "%.4f,%.6f\n", all_s, y);
    text += row;
  }
  return text;
}

}  // namespace ringing_test
