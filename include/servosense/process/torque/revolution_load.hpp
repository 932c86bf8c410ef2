// Torque and force over a revolution of the cutter, from the arcs of contact of a step.
//
// A tooth at angle phi meets a chip of h = s (sin(phi) cos(climb) - w sin(climb)) / sqrt(1 + w^2)
// where the side widens by w = d radius / d height; its edge lags behind its tip by z tan(helix) /
// R at height z. Each arc is integrated over the heights that it belongs to, so that the mean over
// a revolution does not depend on how finely it is sampled. Teeth that run out take
//   h_j = min_k (k s sin(phi) + t_j - t_{j-k}), no less than 0      (Kline and DeVor 1983)
// and have an edge force only where they meet a chip. Frame of forces: model/milling.hpp, x along
// the feed, y to its left, on the tool; of a surface that is inclined, the radial force acts along
// its normal.
#pragma once

#include <array>
#include <vector>

#include "servosense/model/milling.hpp"
#include "servosense/process/engagement/engagement.hpp"
#include "servosense/process/torque/tool_law.hpp"

namespace servosense::process {

struct RevolutionLoad {
  // By angle of the cutter, in equal steps over a revolution.
  std::vector<double> chip_m2;  ///< torque per chip coefficient and metre of feed per tooth
  std::vector<double> edge_m2;  ///< torque per edge coefficient
  std::vector<std::array<double, 3>> force_N;  ///< where the law has forces
};

/// Samples of a revolution: the fewest whole ones a tooth that make as many.
inline constexpr int kRevolutionSamples = 360;

/// `clockwise` as with M3. The law has teeth. Only the side of the cutter counts.
[[nodiscard]] RevolutionLoad revolution_load(const Engagement& engagement, const ToolLaw& law,
                                             double feed_per_tooth_m, bool clockwise);

}  // namespace servosense::process
