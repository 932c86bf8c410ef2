// What axes, drives and operator allow a motion.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <string>

#include "servosense/io/machine_file.hpp"

namespace servosense::process {

inline constexpr double kNoLimit = std::numeric_limits<double>::infinity();

struct MotionLimits {
  // Of x, y, z, each above 0; infinite: without limit.
  std::array<double, 3> velocity_m_s = {kNoLimit, kNoLimit, kNoLimit};
  std::array<double, 3> acceleration_m_s2 = {kNoLimit, kNoLimit, kNoLimit};
  std::array<double, 3> jerk_m_s3 = {kNoLimit, kNoLimit, kNoLimit};
  double feed_override = 1;   ///< of G1 to G3, not of feeds bound to the spindle
  double rapid_override = 1;  ///< of G0
  double tool_change_s = 0;   ///< what a change takes, from standing to standing
  /// What the spindle takes to its speed, where feeds wait for it; 0: none waits.
  double spindle_start_s = 0;
  double cycle_s = 0.001;  ///< servo period of the control; above 0
  /// Moves that the control looks ahead (LinuxCNC, ARC_BLEND_OPTIMIZATION_DEPTH).
  std::size_t look_ahead = 50;
};

/// Limits of a machine file, and the axes (of "xyz") of which it does not say how fast they go and
/// how hard they accelerate.
struct MachineMotion {
  MotionLimits limits;
  std::string unknown_velocity, unknown_acceleration;
  bool unknown_spindle_start = false;  ///< whether feeds wait for the spindle, who knows how long
};
[[nodiscard]] MachineMotion machine_motion(const MachineFile& machine);

}  // namespace servosense::process
