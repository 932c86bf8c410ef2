// Stability of interrupted cutting: Floquet multipliers of milling by semi-discretisation
// (Insperger & Stepan 2004, with the force held by a polynomial of chosen order).
//
//   m q'' + 2 zeta wn m q' + wn^2 m q = F(t),  F = (a Kt / 2) A(t) [u(t) - u(t - T)],
// q the modes, u = (x, y) their sum at the tool tip, T the tooth period, A(t) the directional
// coefficients. One tooth period is cut into intervals whose ends include every entry and exit of
// a tooth. Out of the cut the modes swing freely, solved exactly. In the cut the force is a
// polynomial through Chebyshev-Lobatto points of each interval, and the response of each mode to it
// is exact. The result is a linear map of one tooth period to the next; the tool is stable when
// the largest multiplier (found by Arnoldi iteration, no matrix is formed) lies in the unit circle.
// Only the deflection while in the cut is remembered, so short engagements cost little.
//
// Error of a multiplier: phase_per_interval to the power hold_order + 1 for odd and hold_order + 2
// for even orders; below 2e-5 with the defaults in all cases tested, slot to helix of 45 degrees.
// Helix is exact: A(t) is the mean over the depth, in closed form. Kt is taken at the reference
// chip thickness. Unequal pitch and process damping take the map of a whole revolution instead, in
// steps of equal length (src/identify/revolution_map.hpp): multipliers to 2e-3, and dearer. Not in
// the model: run-out and broken teeth (they change the chip, not how vibration comes back, while
// every tooth cuts), the tooth jumping out of the cut (it bounds the amplitude of chatter, not its
// onset).
#pragma once

#include <complex>
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/stability_lobes.hpp"
#include "servosense/model/milling.hpp"
#include "servosense/model/structural_mode.hpp"

namespace servosense {

struct SemiDiscretizationConfig {
  /// Degree of the polynomial that holds the force over an interval, 1..6.
  int hold_order = 4;
  /// Longest interval, as the phase that the fastest mode runs through in it [rad], above 0.
  double phase_per_interval_rad = 1.5;
  /// Residual of the largest multiplier's vector, of it, above 0.
  double multiplier_tolerance = 1e-9;
};

/// How a multiplier leaves the unit circle.
enum class StabilityLoss {
  hopf,  ///< complex pair: chatter at a frequency unrelated to the tooth passing frequency
  flip,  ///< near -1: the cut repeats every second tooth, at odd halves of the tooth frequency
  fold,  ///< near +1: does not occur in regenerative milling, named for completeness
};

struct CriticalMultiplier {
  std::complex<double> multiplier;  ///< per tooth period; of a pair the one with Im >= 0
  StabilityLoss loss = StabilityLoss::hopf;
  /// The strongest of its frequencies: (arg mu + 2 pi l) / (2 pi T) nearest a resonance.
  double chatter_frequency_hz = 0;
};

struct StabilityChart {
  std::vector<double> spindle_speed_rpm;
  std::vector<double> axial_depth_m;
  /// |mu|: all depths of the first speed, then of the next.
  std::vector<double> spectral_radius;
  /// Limit depth at each speed, refined between the first stable and unstable depth of the chart;
  /// infinite where all its depths are stable.
  std::vector<LobePoint> limit;

  [[nodiscard]] double at(std::size_t speed, std::size_t depth) const {
    return spectral_radius[speed * axial_depth_m.size() + depth];
  }
};

/// Stability of one tool, engagement and structure at any speed and depth.
class SemiDiscretization {
 public:
  /// Errors: as StabilityLobes::from_modes, and a configuration out of range.
  static Expected<SemiDiscretization> create(const Structure& structure, const MillingTool& tool,
                                             const MillingCut& cut,
                                             const SemiDiscretizationConfig& config = {});

  /// In any engagement: of a feed that is not along x, start and exit count on from x as if it
  /// were. Swept angle above 0, at most a turn; its tool and cut as above.
  static Expected<SemiDiscretization> create(const Structure& structure, const MillingTool& tool,
                                             const Engagement& engagement,
                                             const SemiDiscretizationConfig& config = {});

  /// Largest |mu| per tooth period; below 1 is stable. Requires speed > 0, depth >= 0.
  [[nodiscard]] double spectral_radius(double spindle_speed_rpm, double axial_depth_m) const;
  /// The multiplier behind it.
  [[nodiscard]] CriticalMultiplier critical_multiplier(double spindle_speed_rpm,
                                                       double axial_depth_m) const;
  /// Smallest unstable depth up to `deepest_m`, to 1e-6 of itself. Unstable islands thinner than
  /// deepest_m / looks can be missed. Infinite when nothing is unstable.
  [[nodiscard]] LobePoint limit_at(double spindle_speed_rpm, double deepest_m,
                                   int looks = 100) const;
  /// |mu| over a grid, and its border. Depths must rise. `threads` 0 uses every core; the result
  /// does not depend on it. `done` hears the share of the work that is done, from any thread.
  /// Errors: a speed or depth that is missing or not positive.
  [[nodiscard]] Expected<StabilityChart> chart(std::span<const double> spindle_speed_rpm,
                                               std::span<const double> axial_depth_m,
                                               unsigned threads = 0,
                                               const std::function<void(double)>& done = {}) const;

 private:
  SemiDiscretization(const Structure& structure, const MillingTool& tool,
                     const Engagement& engagement, const SemiDiscretizationConfig& config);
  /// The border between a stable and an unstable depth.
  [[nodiscard]] LobePoint limit_between(double spindle_speed_rpm, double stable_m,
                                        double unstable_m) const;

  Structure structure_;
  MillingTool tool_;
  Engagement engagement_;
  SemiDiscretizationConfig config_;
};

}  // namespace servosense
