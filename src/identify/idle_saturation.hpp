// A torque constant that falls with current, seen in an idling run.
//
// The torque of inertia is the reference. With the effect torque-saturation,
//   u = J a + D v + C + s over(u),   over(u) = (|u| - k) sgn u beyond the knee k,
// u the current times its constant at low currents: run-ups at different currents tell s and k, one
// current alone does not. The noise of u is in over(u), too, and would make a loss of its own, so
// over(u) is what the fitted motion says of it (instrumental variables, Reiersol 1945).
#pragma once

#include <optional>

#include "idle_design.hpp"

namespace servosense::idle_fit {

struct FoundSaturation {
  Estimate knee;        ///< N or Nm
  Estimate share_lost;  ///< of each ampere beyond it
  /// What these leave open of inertia, viscous and Coulomb friction, standard errors.
  Eigen::Vector3d errors;
};

struct SeenSaturation {
  std::optional<FoundSaturation> found;
  /// Whether the record would show a loss of 5 % at its highest effort.
  bool told = false;
  double highest = 0;     ///< N or Nm
  double loss_error = 0;  ///< standard error of the share that is lost at the highest effort
};

/// `columns`: what the effort is made of. Drag in the square of speed, friction in proportion to
/// the load and an effort that acts late look alike, and are fitted beside it. `slower`: the same
/// at half the cutoff. The knees of a grid are tried where a loss shows at two of them, or those
/// `near` one [N or Nm] that an earlier round found.
SeenSaturation find_saturation(const IdleDesign& design, const Columns& columns,
                               const IdleDesign& slower, const Columns& slower_columns,
                               std::optional<double> near = {});

}  // namespace servosense::idle_fit
