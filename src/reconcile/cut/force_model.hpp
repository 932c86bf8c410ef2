// Milling forces over the angle of the spindle in steady cutting, fast enough to be fitted.
//
// The chip of tooth i at angle theta is what remains of the thinnest difference to any earlier
// tooth, on trochoidal paths (Tarng 1988, eq. 3-26 to 3-40), with the names of model/milling.hpp:
//   h = max(0, min_k [ D_k sin(theta) + r_i - r_k + D_k cos(theta)/R (D_k cos(theta)/2 - b
//   sin(theta)) ])
// D_k: feed since tooth k was there, b: feed per radian. Forces are linear in the four
// coefficients, hence columns. All layers of a helix see the same curve later, so the sum over
// layers, and the mean over the turn of a sample, are differences of its integral: exact, and no
// dearer than one layer.
//
// A structure that gives and a sensor that rings are taken at the harmonics of the rotation:
// steady cutting repeats every revolution. Chip thickness follows the structure linearly.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "servosense/model/milling.hpp"
#include "servosense/model/structural_mode.hpp"

namespace servosense::reconcile {

/// A dynamometer rings in each direction on its own.
struct SensorMode {
  std::array<double, 2> natural_frequency_hz{};
  std::array<double, 2> damping_ratio{};
};

/// Everything about a cut that does not enter the force linearly.
struct CutState {
  MillingTool tool;  ///< its cutting coefficients are not used
  MillingCut cut;
  double zero_rad = 0;               ///< angle of tooth 1 when the encoder shows 0
  double immersion_scale = 1;        ///< of the radial immersion
  double lag_scale = 1;              ///< of the helix lag: axial depth or helix as given may be off
  double blur_rad = 1e-3;            ///< turn over which a value is averaged
  double sign_x = 1, sign_y = 1;     ///< 1: force on the tool as in model/milling.hpp
  std::array<double, 2> offset_N{};  ///< what the sensor shows without a cut
  bool edges = false;
  bool circular_paths = false;  ///< h = f sin(theta): teeth on circles that are moved on
  Structure structure;
  int vibration_rounds = 6;  ///< of force and displacement settling on each other
  std::optional<SensorMode> sensor;
  double filter_hz = 0;  ///< cut-off of the recorder's filter against aliasing, 0: none
  /// Kt, Kr, Kte, Kre: only what moves the structure depends on them.
  std::array<double, 4> coefficients{};

  [[nodiscard]] Eigen::Index columns() const { return edges ? 4 : 2; }
};

[[nodiscard]] inline bool all_alike(const std::vector<double>& of_teeth) {
  return std::ranges::adjacent_find(of_teeth, std::ranges::not_equal_to{}) == of_teeth.end();
}
/// No tooth is thrown further, shorter, or off its place.
[[nodiscard]] inline bool teeth_alike(const MillingTool& tool) {
  return all_alike(tool.throw_m) && all_alike(tool.broken_fraction) && tool.tooth_angle_rad.empty();
}

/// Sensor or recorder answer to a step over time, so that none is left.
[[nodiscard]] inline bool rings(const CutState& state) {
  return state.sensor || state.filter_hz > 0;
}

/// 0 x, 1 y.
[[nodiscard]] inline std::vector<StructuralMode>& modes_along(CutState& state, std::size_t axis) {
  return axis == 0 ? state.structure.x : state.structure.y;
}

/// Where the tool is in the work, immersion_scale applied.
[[nodiscard]] Engagement engagement_of(const CutState& state);

/// Forces per unit coefficient at `angles_rad` of the spindle: x of all angles, then y. Columns Kt
/// [N/m2], Kr, and with edges Kte [N/m], Kre.
[[nodiscard]] Eigen::MatrixXd force_columns(const CutState& state, double feed_per_tooth_m,
                                            double speed_rad_s, std::span<const double> angles_rad);

/// Angles of the spindle, any turn, where a tooth of this state begins to cut or ends, and where
/// that is smeared by helix and samples: between them the force has no step and no corner.
[[nodiscard]] std::vector<double> breaks_of(const CutState& state);

/// Angles of a revolution where vibration is taken.
inline constexpr Eigen::Index kCutGrid = 1024;
/// Of any angle. Simulations ask it at every step.
[[nodiscard]] inline Eigen::Index grid_index(double angle_rad) {
  static_assert((kCutGrid & (kCutGrid - 1)) == 0);
  const double at = angle_rad * (static_cast<double>(kCutGrid) / kTwoPi);
  const auto whole = static_cast<Eigen::Index>(at);
  return (whole - (at < static_cast<double>(whole) ? 1 : 0)) & (kCutGrid - 1);
}

/// Teeth in the cut at one angle of that grid whose tooth before is as far behind: all layers
/// together, since vibration enters through these sums alone.
struct Contact {
  Eigen::Index at = 0;
  double back = 0;                      ///< grid steps to where the tooth before was here
  double ss_m = 0, sc_m = 0, cc_m = 0;  ///< depth times products of sine and cosine of the angle
};
[[nodiscard]] std::vector<Contact> contacts_of(const CutState& state, double feed_per_tooth_m);

/// Mean chip thickness over the teeth in the cut [m], for maps.
[[nodiscard]] double chip_thickness_m(const CutState& state, double feed_per_tooth_m,
                                      double angle_rad);

}  // namespace servosense::reconcile
