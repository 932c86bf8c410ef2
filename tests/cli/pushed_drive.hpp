// A spindle that is pushed below breakaway: one bristle (Dahl 1968) along its closed form, read by
// an encoder.
#pragma once

#include <cmath>
#include <cstdio>
#include <string>

namespace pushed {

inline constexpr double kStiffness = 10, kBreakaway = 0.015, kMost = 0.012, kPeriod_s = 4;
inline constexpr int kCounts = 1000000;
inline constexpr const char* kMachine =
    "[machine]\nsample_rate_hz = 1000\n[spindle]\ntorque_constant_Nm_per_A = 1\n"
    "inertia_kg_m2 = 1.8e-4\nencoder_counts_per_rev = 1000000\n";

/// `effort` turns the torque into what is reported.
template <typename Effort>
std::string trace(Effort&& effort, int counts = kCounts) {
  std::string text = "t_s,spindle.angle_counts,spindle.torque_Nm\n";
  double x = 0, before = 0;
  for (int i = 0; i < 17000; ++i) {
    const double t = i * 1e-3, phase = t / kPeriod_s - std::floor(t / kPeriod_s);
    const double f = kMost * (phase < 0.25   ? 4 * phase
                              : phase < 0.75 ? 2 - 4 * phase
                                             : 4 * phase - 4);
    const double sense = f < before ? -1 : 1;
    x -= sense * kBreakaway / kStiffness *
         std::log((1 - sense * f / kBreakaway) / (1 - sense * before / kBreakaway));
    before = f;
    char row[96];
    std::snprintf(row, sizeof row, "%.3f,%d,%.9g\n", t,
                  static_cast<int>(std::floor(x * counts / (2 * M_PI) + 0.3)), effort(f));
    text += row;
  }
  return text;
}
inline std::string trace() {
  return trace([](double f) { return f; });
}

}  // namespace pushed
