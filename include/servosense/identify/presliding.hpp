// Presliding stiffness: of a drive that is pushed and does not break away.
//
// Purpose: below breakaway the contact is a spring. Pushed slowly up and down, the effort against
// the motion gives two figures:
//   slope       effort over motion through the whole loop, by least squares, which is what the
//               short knee of the model stands for: friction_knee = Coulomb friction / slope
//   stiffness   just after a reversal, with the breakaway friction towards which it yields: the
//               bristle of Dahl 1968 (exponent 1), dF/dx = s (1 - F/F_b sgn dx), which the effect
//               presliding-hysteresis has
// Method: each push (effort going one way) is, in closed form,
//   F = d F_b - A exp(-d x s/F_b),   d the sense of the push
// linear in F_b and A for a given s/F_b; A is free in every push, so creep between them does not
// count. Readings are taken where they change: there the position is known to far less than a
// count, half way between the two, and all noise is in the effort. Standard errors allow for
// correlated residuals over one push (the larger of Newey and West 1987 and of what the
// autocovariance says). Bad at: pushes so fast that the inertia counts (refused where the inertia
// is known), an effort that is not that of friction alone (an unknown load), laws of more than one
// bristle (said, and then the slope alone is given). Sliding friction is not shown.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/idle.hpp"

namespace servosense {

struct PreslidingIdentification {
  Estimate slope;  ///< N/m or Nm/rad, through the whole loop
  /// The loop is that of one bristle: `stiffness` and `breakaway` are known.
  bool one_bristle = false;
  bool breakaway_fitted = false;  ///< else it is the Coulomb friction of the drive
  Estimate stiffness;             ///< N/m or Nm/rad, just after a reversal
  Estimate breakaway;             ///< N or Nm
  double residual_share = 0;      ///< of the effort that one bristle leaves, rms
  /// m or rad: the knee with which the model's Coulomb friction has this slope, at least four
  /// counts. 0: no friction is known.
  double friction_knee = 0;
  /// The encoder resolves the bristle: a count at a reversal, where it is twice as stiff, moves its
  /// friction by little of the breakaway. Else an observer that follows it by counts does no
  /// better.
  bool resolved = false;
  std::size_t pushes = 0;            ///< one way each
  double travel = 0;                 ///< m or rad, of the largest push
  double effort = 0;                 ///< N or Nm, largest against friction
  std::vector<std::string> remarks;  ///< sentences on what the record could not show
};

/// Identifies one drive that is pushed below breakaway. `base` gives Coulomb friction (0: not
/// known), constant load and inertia; `grain` is what a count of the encoder is [m or rad], 0 where
/// the motion is not reported in counts. Data error, one sentence, where the effort is constant,
/// goes one way only or is too noisy, where its sign does not fit the motion (rectified current),
/// where the encoder is too coarse, where the drive slides and where it is pushed too fast.
Expected<PreslidingIdentification> identify_presliding(const DisturbanceObserverConfig& base,
                                                       const DriveRecord& record, double grain);

}  // namespace servosense
