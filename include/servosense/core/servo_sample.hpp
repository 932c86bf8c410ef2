// Everything the drives of a machine report at one servo instant.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/channel.hpp"
#include "servosense/core/drive_sample.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

/// Feed axes that the monitors watch: x, y, z.
inline constexpr std::size_t kAxes = 3;

[[nodiscard]] constexpr Channel axis_channel(std::size_t axis) noexcept {
  return static_cast<Channel>(static_cast<std::size_t>(Channel::x) + axis);
}

/// What the effort of a drive is reported as.
enum class EffortKind : std::uint8_t { current_A, torque_Nm, force_N };

/// What one drive reports.
struct DriveSignal {
  MotionKind motion = MotionKind::counts;
  EffortKind effort = EffortKind::current_A;
};

/// Where the controller does not say which block it works on.
inline constexpr std::int32_t kNoBlock = -1;

template <RealNumber Real>
struct ServoSample {
  Nanoseconds t_ns = 0;
  RawDriveSample<Real> spindle;
  std::array<RawDriveSample<Real>, kAxes> axis;
  std::int32_t nc_block = kNoBlock;  ///< at which the controller is: any number, to mark a place
  Real feed_override = 1;            ///< of the programmed feed; 0: feed hold
};

}  // namespace servosense
