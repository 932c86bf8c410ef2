// The constants of the torque equation from cuts of which feed, geometry and torque are known.
//
//   M = k1 V f + (k2 f + k3) S      (Bertok 1984, eq. 4.1)
//
// Linear in k1, k2, k3: least squares over V f, f S and S, weighted because a torque is off by a
// share of itself rather than by so many Nm. Which share of a torque belongs to
// which is only seen where both the feed and S/V (the study's L/a) vary: with one of them constant
// two columns are proportional. Constants are not negative; one that comes out so is held at 0 and
// the others are found again.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "servosense/core/expected.hpp"

namespace servosense {

/// A cut, or a stretch of one.
struct TorqueCut {
  double removed_m2 = 0;  ///< V: removed volume over path
  double contact_m2 = 0;  ///< S: area of contact
  double feed_per_tooth_m = 0;
  double torque_Nm = 0;  ///< mean, without that of the air
};

/// Spread of feeds and of S/V below which they count as one (chosen: what controls and stock are
/// off by).
inline constexpr double kLeastSpread = 0.05;
/// Condition of the columns, each of length 1, from which on they are collinear (chosen: errors of
/// 1 % of the torque then make constants that are as wrong as they are large).
inline constexpr double kMostCondition = 100;

struct TorqueEquationFit {
  std::array<double, 3> k{};               ///< k1, k2 [N/m2], k3 [N/m]
  std::array<double, 3> standard_error{};  ///< of one that is held: 0
  std::array<bool, 3> held_at_zero{};
  double residual_Nm = 0;  ///< standard deviation of a cut's torque
  /// What the equation was off by, of the measured torque, in cuts that did not teach it: each is
  /// left out once (root mean square).
  double relative_error = 0;
  std::size_t cuts = 0;
};

/// Data error for fewer than four cuts, for values that are not above 0, and where feeds or S/V do
/// not vary enough, or only together.
Expected<TorqueEquationFit> fit_torque_equation(std::span<const TorqueCut> cuts);

}  // namespace servosense
