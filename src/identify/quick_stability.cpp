#include "quick_stability.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace servosense {

double limit_near(const SemiDiscretization& stability, double spindle_speed_rpm, double guess_m,
                  double deepest_m, double tolerance) {
  constexpr double kLeast = 1e-6;
  // Growth rises by about this much where the depth rises by its own size; only a first step.
  constexpr double kSlope = 0.4;
  const auto growth = [&](double depth_m) {
    return std::log(std::max(1e-300, stability.spectral_radius(spindle_speed_rpm, depth_m)));
  };
  double stable_m = 0, unstable_m = 0;
  double below = 0, above = 0;  // growth at both
  double depth_m = std::min(guess_m, deepest_m), step = 0;
  while (stable_m == 0 || unstable_m == 0) {
    const double g = growth(depth_m);
    // A little beyond where the border should be; the farther from there, the faster.
    step = std::max(2 * step, std::clamp(std::abs(g) / kSlope, tolerance, 0.3));
    if (g < 0) {
      stable_m = depth_m;
      below = g;
      if (depth_m >= deepest_m) return std::numeric_limits<double>::infinity();
      if (unstable_m == 0) depth_m = std::min(deepest_m, depth_m * (1 + step));
    } else {
      unstable_m = depth_m;
      above = g;
      if (depth_m < deepest_m * kLeast) return depth_m;
      if (stable_m == 0) depth_m /= 1 + step;
    }
  }
  // Regula falsi, the end that stays halved (Illinois), until it comes back to where it was.
  int side = 0;
  double last_m = depth_m;
  while (unstable_m - stable_m > tolerance * unstable_m) {
    const double share = std::clamp(below / (below - above), 0.02, 0.98);
    const double middle_m = stable_m + share * (unstable_m - stable_m);
    if (side != 0 && std::abs(middle_m - last_m) < 0.5 * tolerance * middle_m) return middle_m;
    const double g = growth(middle_m);
    last_m = middle_m;
    if (g < 0) {
      stable_m = middle_m;
      below = g;
      if (side < 0) above /= 2;
      side = -1;
    } else {
      unstable_m = middle_m;
      above = g;
      if (side > 0) below /= 2;
      side = 1;
    }
  }
  return stable_m + below / (below - above) * (unstable_m - stable_m);
}

}  // namespace servosense
