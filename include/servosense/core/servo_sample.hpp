// Everything the drives of a machine report at one servo instant.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/channel.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

/// Feed axes that the monitors of a controller watch: x, y, z.
inline constexpr std::size_t kAxes = 3;
/// With those that turn, a, b, c, which only hosts have room for.
inline constexpr std::size_t kAllAxes = 6;

[[nodiscard]] constexpr Channel axis_channel(std::size_t axis) noexcept {
  return static_cast<Channel>(static_cast<std::size_t>(Channel::x) + axis);
}
/// The other way; of an axis alone.
[[nodiscard]] constexpr std::size_t axis_index(Channel axis) noexcept {
  return static_cast<std::size_t>(axis) - static_cast<std::size_t>(Channel::x);
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

/// Of a spindle and the first `Axes` axes.
template <RealNumber Real, std::size_t Axes = kAxes>
struct ServoSample {
  Nanoseconds t_ns = 0;
  RawDriveSample<Real> spindle;
  std::array<RawDriveSample<Real>, Axes> axis;
  std::int32_t nc_block = kNoBlock;  ///< at which the controller is: any number, to mark a place
  Real feed_override = 1;            ///< of the programmed feed; 0: feed hold
};

/// Of every drive that a machine may have.
struct MachineServoSample : ServoSample<double, kAllAxes> {
  RawDriveSample<double> spindle2;

  /// What a stack hears whose only spindle is this one.
  [[nodiscard]] ServoSample<double, kAllAxes> of_spindle(Channel which) const noexcept {
    ServoSample<double, kAllAxes> one = *this;
    one.spindle = drive(which);
    return one;
  }
  [[nodiscard]] RawDriveSample<double>& drive(Channel channel) noexcept {
    return channel == Channel::spindle    ? spindle
           : channel == Channel::spindle2 ? spindle2
                                          : axis[axis_index(channel)];
  }
  [[nodiscard]] const RawDriveSample<double>& drive(Channel channel) const noexcept {
    return const_cast<MachineServoSample*>(this)->drive(channel);
  }
};

}  // namespace servosense
