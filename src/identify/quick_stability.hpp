// Stability at many structures: semi-discretisation with fewer points, and limit depths from a
// good guess.
#pragma once

#include "servosense/identify/semi_discretization.hpp"
#include "servosense/identify/uncertain_cut.hpp"

namespace servosense {

/// Limit depths differ from the default ones by less than 0.3 % (test_identify recommended_cut).
inline constexpr SemiDiscretizationConfig kQuick{3, 2.0, 1e-4};

[[nodiscard]] inline SemiDiscretization quick_stability(const UncertainCut::Possible& possible,
                                                        const MillingCut& cut) {
  // What create() refuses was refused with the values of the file.
  return *SemiDiscretization::create(possible.structure, possible.tool, cut, kQuick);
}

/// Depth between a stable one and an unstable one, sought from `guess_m` outwards. Infinite when
/// stable up to `deepest_m`. Islands of instability below the guess are not looked for.
[[nodiscard]] double limit_near(const SemiDiscretization& stability, double spindle_speed_rpm,
                                double guess_m, double deepest_m, double tolerance = 0.003);

}  // namespace servosense
