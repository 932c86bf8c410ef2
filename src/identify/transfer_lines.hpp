// Lines of an input's spectrum: which of them are excited, and which stand alone.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "servosense/core/units.hpp"

namespace servosense::transfer {

constexpr double kUsableCoherence = 0.9;

/// Neighbouring lines, both ends included.
struct LineRun {
  std::size_t from = 0, to = 0;
};

inline std::vector<LineRun> runs_of(const std::vector<bool>& holds) {
  std::vector<LineRun> runs;
  for (std::size_t m = 0; m < holds.size(); ++m)
    if (holds[m]) {
      if (runs.empty() || runs.back().to + 1 != m) runs.push_back({m, m});
      runs.back().to = m;
    }
  return runs;
}

/// Power that is more than what a Hann window lets through from lines further than two away
/// (envelope of its side lobes, half a line nearer), and more than rounding.
inline std::vector<bool> excited_lines(const std::vector<double>& power) {
  constexpr double kMore = 4;          // than that bound
  constexpr double kRounding = 1e-20;  // of the highest line
  constexpr std::size_t kLobe = 2;
  std::vector<double> side(power.size() + 1, 0.0);
  const std::size_t reach = std::min<std::size_t>(power.size(), 1024);  // beyond is rounding
  for (std::size_t d = kLobe + 1; d < reach; ++d) {
    const double x = static_cast<double>(d) - 0.5;
    side[d] = std::pow(kPi * x * (x * x - 1), -2);
  }
  const double highest = power.empty() ? 0 : *std::max_element(power.begin(), power.end());
  std::vector<bool> excited(power.size(), false);
  for (std::size_t m = 0; m < power.size(); ++m) {
    double through = 0;
    const std::size_t from = m > reach ? m - reach : 0;
    for (std::size_t k = from; k < std::min(power.size(), m + reach); ++k)
      through += power[k] * side[k > m ? k - m : m - k];
    if (m == 1)  // what the mean of a segment, which is taken off, has of other lines
      for (std::size_t k = kLobe + 2; k < power.size(); ++k)
        through += power[k] / std::pow(kPi * (static_cast<double>(k) - 0.5), 2);
    excited[m] = power[m] > kMore * through && power[m] > kRounding * highest;
  }
  return excited;
}

/// No wider than the lobe of the window, and ten times as strong as what surrounds it.
inline bool is_single_line(const LineRun& run, const std::vector<double>& power) {
  constexpr std::size_t kWidest = 5, kAround = 16;
  constexpr double kStrong = 10;
  if (run.to - run.from >= kWidest) return false;
  std::vector<double> around;
  const std::size_t low = run.from > kAround ? run.from - kAround : 1;
  const std::size_t high = std::min(run.to + kAround, power.size() - 2);
  for (std::size_t m = low; m <= high; ++m)
    if (m + 2 < run.from || m > run.to + 2) around.push_back(power[m]);
  if (around.empty()) return true;
  const auto middle = around.begin() + static_cast<std::ptrdiff_t>(around.size() / 2);
  std::nth_element(around.begin(), middle, around.end());
  const auto at = power.begin();
  const double peak = *std::max_element(at + static_cast<std::ptrdiff_t>(run.from),
                                        at + static_cast<std::ptrdiff_t>(run.to) + 1);
  return peak > kStrong * *middle;
}

/// Where its power has its middle, in lines.
inline double middle_of(const LineRun& run, const std::vector<double>& power) {
  double sum = 0, moment = 0;
  for (std::size_t m = run.from; m <= run.to; ++m) {
    sum += power[m];
    moment += power[m] * static_cast<double>(m);
  }
  return moment / sum;
}

}  // namespace servosense::transfer
