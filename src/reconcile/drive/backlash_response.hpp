// The load behind backlash, driven by the measured motion of the motor.
//   d = x - x_load,  |d| <= b/2,  share = m2 / M,  ratio = (friction of load / of drive) / share
//   on a flank:  the load moves with the motor while a + ratio (D v + C S) / M + L / (share M)
//                presses it there
//   in between:  v_load' = -ratio (D v_load + C sgn v_load) / M - L / (share M)
//   at a flank:  v_load = v
// It adds share * (M (a_load - a) + ratio (friction at v_load - friction at v)) to the effort, so
// the share of the mass is linear. Real loads bounce on their flanks, a dozen times, and no record
// of the motor resolves that; flights and first impacts are told by width and ratio alone, and a
// load that bounces is, on average over its bounces, carried along (its momentum is). A simulated
// bounce that is off by a fraction of its period does worse than none.
#pragma once

#include "reconcile/drive/signals.hpp"

namespace servosense::reconcile {

struct BacklashLoad {
  double width = 0;
  double ratio = 1;    ///< > 0
  double share = 0.5;  ///< matters where there are loads
};

/// What pulls at the stage: a constant load, a spring. Working rate; empty where nothing does.
[[nodiscard]] Column loads_of(const DriveSignals& signals, const DriveModelConfig& drive);

/// What backlash adds to the effort for a load of all the mass, in rows.
[[nodiscard]] Column response_of_backlash(const DriveSignals& signals,
                                          const DriveModelConfig& drive,
                                          const BacklashLoad& backlash, const Column& loads);

}  // namespace servosense::reconcile
