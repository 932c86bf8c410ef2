// How fast chatter grows: amplitude ratio of one tooth pass to the one before (Koike 2016,
// eq. 8-1, 8-2).
//
//   det[I - (a Kt / 2) (1 - exp(-j w T) / mu) A0 G(jw)] = 0
// has the closed form mu exp(j w T) = lambda / (lambda - c), c = 4 pi / (N a Kt), lambda an
// eigenvalue of alpha G (see stability_lobes.hpp); of all w that satisfy it the largest mu counts.
// mu < 1 dies out, mu = 1 is the lobe, mu > 1 grows. The steep side of a lobe is its right
// (higher-speed) one, so a cut that slows down through a lobe starts to chatter at once, and one
// that speeds up builds it slowly.
//
// Zeroth order, real w: a steady oscillation scaled once per tooth. Near mu = 1 it agrees with the
// Floquet multiplier; far from it, it is a measure, not a rate: it ranks cuts (docs).
//
// Where lambda = c at some w, mu is infinite, and solutions appear that no lobe has let through:
// beyond that depth mu can exceed 1 in a stable cut. Axes whose modes are unlike can have such a
// depth below the limit of the lobes; `valid_to_m` tells it. Beyond it use
// semi_discretization.hpp.
#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/model/milling.hpp"
#include "servosense/model/structural_mode.hpp"

namespace servosense {

struct GrowthMap {
  std::vector<double> spindle_speed_rpm;
  std::vector<double> axial_depth_m;
  /// All depths of the first speed, then of the next.
  std::vector<double> amplitude_ratio;
  /// Up to this depth mu = 1 is the lobe diagram (but for 3 of 8769 random machines); infinite
  /// where nothing spoils it. Do not rely on the map beyond it.
  double valid_to_m = std::numeric_limits<double>::infinity();

  [[nodiscard]] double at(std::size_t speed, std::size_t depth) const {
    return amplitude_ratio[speed * axial_depth_m.size() + depth];
  }
};

/// mu over the grid; spindle speed and depth of `cut` are not used. Errors: as
/// StabilityLobes::from_modes, and a speed or depth that is missing or not positive.
[[nodiscard]] Expected<GrowthMap> growth_map(const Structure& structure, const MillingTool& tool,
                                             const MillingCut& cut,
                                             std::span<const double> spindle_speed_rpm,
                                             std::span<const double> axial_depth_m);

}  // namespace servosense
