#include "impact_range.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace servosense::impact {
namespace {

constexpr std::size_t kRow = 3;    // samples: two may be alike on either side of a peak
constexpr double kTooSteep = 2.5;  // times the fall of a parabola that is as flat on top
constexpr double kUnsure = 4;      // standard deviations of noise
constexpr double kAway = 0.5;      // of the top: between two swings
constexpr double kSame = 1e-9;     // of the range: rounding
constexpr double kWhole = 0.05;    // of a step: what a table's last digit may add

/// Whether at least three samples in a row lie within `unsure` of the top, from which x falls off
/// too steeply for that and for its noise.
bool in_a_row(std::span<const double> x, double sign, double top, double unsure, double noise) {
  for (std::size_t i = 0; i < x.size();) {
    if (sign * x[i] < top - unsure) {
      ++i;
      continue;
    }
    std::size_t to = i;
    while (to < x.size() && sign * x[to] >= top - unsure) ++to;
    const std::size_t row = to - i, beside = std::max<std::size_t>(2, row / 2);
    // Ends of the record on a plateau: there is nothing to compare with.
    if (row >= kRow && i >= beside && to + beside <= x.size()) {
      const double fall = top - 0.5 * sign * (x[i - beside] + x[to + beside - 1]);
      const double parabola =
          unsure * std::pow(1 + 2 * static_cast<double>(beside) / static_cast<double>(row - 1), 2);
      if (fall > kTooSteep * parabola + kUnsure * noise) return true;
    }
    i = to;
  }
  return false;
}

}  // namespace

double smallest_step(std::span<const double> x) {
  std::vector<double> sorted;
  for (const double v : x)
    if (std::isfinite(v)) sorted.push_back(v);
  if (sorted.size() < 2) return 0;
  std::sort(sorted.begin(), sorted.end());
  const double range = sorted.back() - sorted.front();
  double step = range;
  for (std::size_t i = 1; i < sorted.size(); ++i) {
    const double d = sorted[i] - sorted[i - 1];
    if (d > kSame * range) step = std::min(step, d);
  }
  // Of a smooth signal, too, some difference is the smallest: a converter gives whole steps.
  for (const double v : sorted) {
    const double steps = (v - sorted.front()) / step;
    if (!(std::abs(steps - std::round(steps)) < kWhole)) return 0;
  }
  return step;
}

bool cut_off(std::span<const double> x, double sign, double step, double noise) {
  if (x.size() < kRow) return false;
  double top = sign * x[0];
  for (const double v : x) top = std::max(top, sign * v);
  // Noise makes no two values alike, unless they are steps.
  for (std::size_t i = 1; i < x.size() && step == 0 && noise > kSame * top; ++i)
    if (sign * x[i] >= top && sign * x[i - 1] >= top) return true;
  // The converter's end makes them the same, an amplifier's alike within the noise that follows it.
  const double same = noise > step ? 0.5 * step : step;
  if (in_a_row(x, sign, top, same, noise) ||
      in_a_row(x, sign, top, std::max(step, kUnsure * noise), 0))
    return true;
  // Swings that end at the same value: those of a structure die away.
  double mean = 0;
  for (const double v : x) mean += sign * v / static_cast<double>(x.size());
  std::size_t ends = 0;
  bool away = true;
  for (const double v : x) {
    if (away && sign * v >= top - step) ++ends, away = false;
    if (sign * v < mean + kAway * (top - mean)) away = true;
  }
  return ends > 1;
}

}  // namespace servosense::impact
