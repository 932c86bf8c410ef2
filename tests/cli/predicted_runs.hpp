// Runs of a program of slots and side cuts that 'program predict' has predicted: torque by the
// equation of the study with areas in closed form, friction, ripple and noise, and what happens to
// a run: overrides, feed hold, pauses, a start in the middle, stock and tool that are wrong.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "program.hpp"

namespace predicted_runs {

constexpr double kRate_hz = 1000, kPi = 3.14159265358979323846;
constexpr double kRpm = 1200, kRadius = 10, kTeeth = 3;
constexpr double kK1 = 1.39, kK2 = 0.36, kK3 = 0.00316;
constexpr double kViscous = 0.002, kCoulomb_Nm = 0.3;

inline const char* const kMachine =
    "[spindle]\ntorque_constant_Nm_per_A = 0.5\ninertia_kg_m2 = 0.01\n"
    "viscous_friction_Nm_s_per_rad = 0.002\ncoulomb_friction_Nm = 0.3\n"
    "encoder_counts_per_rev = 65536\n[tool]\ndiameter_m = 0.02\nteeth = 3\n";
inline const char* const kLaw = "torque_equation = 1.39 0.36 0.00316\n";
inline const char* const kStock = "--stock box:0,0,-0.02,0.08,0.12,0";

/// A pass of 100 mm along x through a block of 80 mm: a slot (aside = 0), or a side cut beside the
/// slot before it, as deep.
struct Pass {
  double depth, aside, feed;  // mm, mm, mm/min
};
using Passes = std::vector<Pass>;

inline std::string program_text(const Passes& passes) {
  std::string text = "G21 G90 G17 G61\nS1200 M3\nG0 Z5\n";
  for (std::size_t i = 0; i < passes.size(); ++i) {
    char block[160];
    std::snprintf(block, sizeof block, "G0 X-10 Y%.4f\nG0 Z-%.4f\nG1 X90 F%.4f\nG0 Z5\n",
                  30.0 * static_cast<double>(i / 2) + 15 + passes[i].aside, passes[i].depth,
                  passes[i].feed);
    text += block;
  }
  return text + "M2\n";
}
inline int line_of(std::size_t pass) { return 4 + 4 * static_cast<int>(pass) + 2; }

/// V and S in mm2 where the axis stands at x, the block from 0 to 80.
inline void areas(const Pass& p, double x, double& v, double& s) {
  // Angles from straight ahead at which the circle is within the block in x, and in uncut material.
  const double from = p.aside > 0 ? std::acos(1 - p.aside / kRadius) : kPi;
  v = s = 0;
  constexpr int steps = 160;
  for (int i = 0; i < steps; ++i) {
    const double a = kPi * (i + 0.5) / steps, at = x + kRadius * std::sin(a);
    if (at < 0 || at > 80 || a > from) continue;
    v += kRadius * std::sin(a) * kPi / steps * p.depth;
    s += kRadius * kPi / steps * p.depth;
  }
}

struct Run {
  unsigned seed = 1;
  double torque = 1;
  double growth = 0;  ///< of the depth along a pass, of it
  std::size_t grows = 0;
  std::size_t first = 0;
  double slower_from = 1e9, slower = 1;  ///< override from then on
  bool hold = false;                     ///< of the feed for 3 s
  std::size_t holds = 2;                 ///< in this pass
  double pause_behind = 1e9;             ///< the spindle stands behind this pass and those after it
  bool no_tool = false;
  double higher = 0, aside = 0;  ///< the stock, mm, above its place and along x
};

/// Writes the trace. The highest mean torque of a revolution, without noise.
inline double record(const std::string& name, const Passes& passes, const Run& run) {
  std::mt19937 random(run.seed);
  std::normal_distribution<double> noise(0, 0.15);
  std::string text =
      "t_s,spindle.angle_counts,spindle.current_A,machine.nc_block,machine.feed_override\n";
  double t = 0, angle = 0, highest = 0;
  const auto sample = [&](double cutting, int line, double feed, double speed) {
    const double torque_of_cut = run.no_tool ? 0 : cutting * run.torque;
    highest = std::max(highest, torque_of_cut);
    angle += speed / kRate_hz;
    const double torque = torque_of_cut * (1 + 0.3 * std::sin(3 * angle) + 0.1 * std::sin(angle)) +
                          (speed > 0 ? kViscous * speed + kCoulomb_Nm : 0) + noise(random);
    char row[120];
    std::snprintf(row, sizeof row, "%.6f,%lld,%.7g,%d,%.4g\n", t,
                  static_cast<long long>(std::floor(angle / (2 * kPi) * 65536)), torque / 0.5, line,
                  feed);
    text += row;
    t += 1 / kRate_hz;
  };
  const double speed = kRpm * 2 * kPi / 60;
  for (int i = 0; i < 500; ++i) sample(0, 3, 1, speed);
  for (std::size_t i = run.first; i < passes.size(); ++i) {
    Pass p = passes[i];
    p.depth += run.higher;
    bool held = false;
    for (double x = -10; x < 90;) {
      const double share = t >= run.slower_from ? run.slower : 1;
      if (run.hold && !held && x > 20 && i == run.holds) {
        for (int k = 0; k < 3000; ++k) sample(0, line_of(i), 0, speed);
        held = true;
      }
      double v = 0, s = 0;
      areas(p, x - run.aside, v, s);
      const double deeper = i == run.grows ? 1 + run.growth * std::max(0.0, x) / 80 : 1;
      const double f = p.feed * share / (kRpm * kTeeth);
      sample(v > 0 ? (kK1 * v * f + (kK2 * f + kK3) * s) * deeper : 0, line_of(i), share, speed);
      x += p.feed * share / 60 / kRate_hz;
    }
    for (int k = 0; k < 100; ++k) sample(0, line_of(i) + 1, 1, speed);
    if (static_cast<double>(i) >= run.pause_behind) {
      for (int k = 0; k < 1000; ++k)
        sample(0, line_of(i) + 1, 1, speed * std::max(0, 500 - k) / 500);
      for (int k = 0; k < 1000; ++k) sample(0, line_of(i) + 1, 1, speed * std::min(500, k) / 500);
    }
  }
  program_test::put(name, text);
  return highest;
}

}  // namespace predicted_runs
