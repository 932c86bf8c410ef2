#include "cutting_level.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace servosense {
namespace {

// Conventions.
constexpr double kNothing = 0.02;     // of a great load
constexpr double kLeastGroup = 0.03;  // of the stretches: a state
constexpr double kKernel = 0.06;  // of the logarithm: loads of one state differ by some per cent
constexpr double kValley = 0.5;   // of the density of the lesser state, between the two
constexpr std::size_t kAboveAir = 27;  // quarters of a kernel: half as much again as the air

}  // namespace

double cutting_level_of(std::vector<double> loads, const std::vector<double>& border) {
  if (loads.size() < 4) return 0;
  std::sort(loads.begin(), loads.end());
  // An effort of nothing is air as well.
  const double least = kNothing * loads[loads.size() * 9 / 10];
  if (!(least > 0)) return 0;
  const auto some = std::lower_bound(loads.begin(), loads.end(), least);
  const double nothing = some == loads.begin() ? 0 : std::sqrt(least * *some);
  loads.erase(loads.begin(), some);
  for (double& x : loads) x = std::log(x);
  // Density of the logarithms, a Gaussian kernel each.
  const auto n = static_cast<double>(loads.size());
  const double from = loads.front() - 3 * kKernel, step = kKernel / 4;
  std::vector<double> density(
      static_cast<std::size_t>((loads.back() - loads.front() + 6 * kKernel) / step) + 1);
  for (std::size_t i = 0; i < density.size(); ++i)
    for (const double x : loads) {
      const double apart = (from + static_cast<double>(i) * step - x) / kKernel;
      if (std::abs(apart) < 6) density[i] += std::exp(-0.5 * apart * apart);
    }
  // Its hills, from the lightest load on. One of few stretches is a burst or a moment, no state.
  const auto highest = [&](std::size_t begin, std::size_t end) {
    return static_cast<std::size_t>(
        std::max_element(density.begin() + static_cast<std::ptrdiff_t>(begin),
                         density.begin() + static_cast<std::ptrdiff_t>(end)) -
        density.begin());
  };
  std::vector<std::size_t> peaks;
  for (std::size_t i = 1, begin = 0; i < density.size(); ++i) {
    const bool last = i + 1 == density.size();
    if (!last && !(density[i] <= density[i - 1] && density[i] < density[i + 1])) continue;
    const double low = from + static_cast<double>(begin) * step;
    const double high = from + static_cast<double>(i) * step;
    const auto inside =
        std::count_if(loads.begin(), loads.end(), [&](double x) { return x >= low && x < high; });
    if (static_cast<double>(inside) >= kLeastGroup * n) peaks.push_back(highest(begin, i));
    begin = i;
  }
  if (peaks.size() < 2) return nothing;
  const std::size_t air = peaks[0], cut = peaks[1];
  const auto valley = static_cast<std::size_t>(
      std::min_element(density.begin() + static_cast<std::ptrdiff_t>(air),
                       density.begin() + static_cast<std::ptrdiff_t>(cut)) -
      density.begin());
  if (density[valley] > kValley * std::min(density[air], density[cut])) return nothing;
  const double level =
      std::exp(from + static_cast<double>(std::min(valley, air + kAboveAir)) * step);
  const auto in_air =
      std::count_if(border.begin(), border.end(), [&](double x) { return x < level; });
  return 2 * static_cast<std::size_t>(in_air) >= border.size() ? level : nothing;
}

}  // namespace servosense
