// What the blocks hear of a drive: one clean step of motion and one effort per servo period.
// core/drive_input.hpp makes it of what a drive reports.
#pragma once

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"

namespace servosense {

/// One drive at one servo instant, conditioned. Units: rad and Nm for a spindle, m and N for an
/// axis.
template <RealNumber Real>
struct DriveSample {
  Real increment = 0;       ///< motion since the previous sample
  Real position = 0;        ///< motion since the start
  Real turn_angle_rad = 0;  ///< angle within one turn of the motor or screw, [0, 2 pi)
  Real effort = 0;          ///< torque or force the motor exerts
  Quality quality = Quality::good;
};

}  // namespace servosense
