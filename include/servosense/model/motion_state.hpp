// What the drive model needs to know about the motion at one instant.
#pragma once

#include "servosense/core/real_time.hpp"

namespace servosense {

/// Units: m, m/s, N for an axis; rad, rad/s, Nm for a spindle. The observer fills it from encoder
/// and current, the simulator from its own state: the same terms are evaluated by both.
template <RealNumber Real>
struct MotionState {
  Real position = 0;  ///< from the start of the record, motor side
  Real velocity = 0;
  Real direction = 0;       ///< sign of motion, -1..1, continuous through rest (ElastoplasticSign)
  Real turn_angle_rad = 0;  ///< angle within one turn of motor or screw, [0, 2 pi)
  Real increment = 0;       ///< motion since the last sample
  Real acceleration = 0;
  Real effort = 0;   ///< force or torque the motor exerts
  Real cutting = 0;  ///< force or torque that opposes the load, where it is known: the simulator
};

}  // namespace servosense
