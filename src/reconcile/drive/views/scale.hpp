// The encoder of the load (a scale on the stage, an encoder on the table or the spindle) against
// that of the motor: what lies between the two shows there directly.
#pragma once

#include <optional>
#include <vector>

#include "reconcile/drive/candidates/candidates.hpp"
#include "servosense/reconcile/options.hpp"
#include "servosense/reconcile/problem.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {

/// Width of backlash, as the scale shows it [m or rad].
struct LostMotion {
  double width = 0, error = 0;
  double windup = 0;  ///< what friction at the stage winds the drive up by, both ways
};

/// What the scale shows: effects with their gaps in metres or rad.
struct ScaleFindings {
  std::vector<FoundEffect> effects;
  std::vector<EffectSetting> settings;  ///< of the effects, in their order
  std::vector<NotTestable> not_testable;
  double left = 0;                 ///< between scale and motor, rms [m or rad]
  bool at_floor = true;            ///< no more is left than the scale cannot tell
  std::optional<LostMotion> lost;  ///< none where something pulls at the stage
  BetweenEncoders between;         ///< for the report
};

/// What the forces showed before.
struct SeenInForces {
  bool eccentric = false;  ///< the encoder: the motor's error then, not the screw's
  bool sprung = false;     ///< a spring load, that winds the drive up in proportion to position
};

/// Compares scale and motor over the rows of the comparison of forces, whose motion and coordinates
/// it shares:
///   scale - motor = zero - windup + lead error - backlash + noise
/// Windup is the force passed on to the stage over the stiffness between. Of a drive that turns the
/// error once and twice a turn, of its own encoder and of the motor's, stands in the place of the
/// lead error and gets no name. Nothing when the trace has no scale, or one that departs from the
/// motor by more than 1 % of the travel.
[[nodiscard]] std::optional<ScaleFindings> compare_scale(const DriveSituation& situation,
                                                         const Problem& forces,
                                                         const SeenInForces& seen,
                                                         const Options& options);

}  // namespace servosense::reconcile
