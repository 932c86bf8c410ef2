// Which part of the machine a signal belongs to, and what it measures. The names are those of the
// trace file: `<channel>.<quantity>_<unit>`.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace servosense {

enum class Channel : std::uint8_t {
  spindle,
  x,
  y,
  z,
  a,
  b,
  c,
  tool,
  dyno,
  hammer,
  machine,
  spindle2,
  x2,  ///< the second motor of a gantry; no drive of its own
  y2,
  z2,
  accelerometer,  ///< at the spindle or the work
  microphone
};

inline constexpr std::array<std::string_view, 17> kChannelNames = {
    "spindle",   "x",      "y",       "z",        "a",  "b",  "c",  "tool",
    "dyno",      "hammer", "machine", "spindle2", "x2", "y2", "z2", "accelerometer",
    "microphone"};

[[nodiscard]] constexpr std::string_view name_of(Channel channel) noexcept {
  return kChannelNames[static_cast<std::size_t>(channel)];
}

[[nodiscard]] constexpr std::optional<Channel> channel_from(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kChannelNames.size(); ++i)
    if (kChannelNames[i] == name) return static_cast<Channel>(i);
  return std::nullopt;
}

/// The drives of a machine, in the order in which they are told of.
inline constexpr std::array kDriveChannels = {Channel::spindle, Channel::x,       Channel::y,
                                              Channel::z,       Channel::a,       Channel::b,
                                              Channel::c,       Channel::spindle2};

[[nodiscard]] constexpr bool is_spindle(Channel c) noexcept {
  return c == Channel::spindle || c == Channel::spindle2;
}
[[nodiscard]] constexpr Channel other_spindle(Channel spindle) noexcept {
  return spindle == Channel::spindle ? Channel::spindle2 : Channel::spindle;
}
/// An axis that turns: the name is that of ISO 841.
[[nodiscard]] constexpr bool is_rotary_axis(Channel c) noexcept {
  return c >= Channel::a && c <= Channel::c;
}
[[nodiscard]] constexpr bool is_linear_axis(Channel c) noexcept {
  return c >= Channel::x && c <= Channel::z;
}
[[nodiscard]] constexpr bool is_axis(Channel c) noexcept {
  return is_linear_axis(c) || is_rotary_axis(c);
}
[[nodiscard]] constexpr bool is_drive(Channel c) noexcept { return is_spindle(c) || is_axis(c); }
/// A sensor of vibration beside the drives.
[[nodiscard]] constexpr bool is_sensor(Channel c) noexcept {
  return c == Channel::accelerometer || c == Channel::microphone;
}
inline constexpr std::array kSensorChannels = {Channel::accelerometer, Channel::microphone};
/// A drive in rad, Nm and kg m2; the others are in m, N and kg.
[[nodiscard]] constexpr bool is_turning(Channel c) noexcept {
  return is_spindle(c) || is_rotary_axis(c);
}
/// Of a linear axis: where the second motor of a gantry reports.
[[nodiscard]] constexpr Channel second_motor_of(Channel axis) noexcept {
  return static_cast<Channel>(static_cast<std::size_t>(Channel::x2) +
                              static_cast<std::size_t>(axis) -
                              static_cast<std::size_t>(Channel::x));
}
/// Section of a drive in the machine file, without brackets; of no drive, its name.
[[nodiscard]] constexpr std::string_view section_of(Channel c) noexcept {
  constexpr std::array<std::string_view, 6> kAxisSections = {"axis.x", "axis.y", "axis.z",
                                                             "axis.a", "axis.b", "axis.c"};
  if (!is_axis(c)) return name_of(c);
  return kAxisSections[static_cast<std::size_t>(c) - static_cast<std::size_t>(Channel::x)];
}

/// Every quantity a trace may carry; the unit is part of the name.
enum class Quantity : std::uint8_t {
  angle_rad,
  angle_counts,
  speed_rad_s,
  position_m,
  velocity_m_s,
  acceleration_m_s2,
  displacement_m,
  command_angle_rad,
  command_position_m,
  command_velocity_m_s,
  current_A,
  torque_Nm,
  force_N,
  power_W,
  load_V,
  load_percent,
  torque_percent,
  current_percent,
  voltage_V,
  temperature_C,
  feed_override,
  feed_per_tooth_m,
  nc_block,
  force_x_N,
  force_y_N,
  force_z_N,
  displacement_x_m,
  displacement_y_m,
  acceleration_x_m_s2,
  acceleration_y_m_s2,
  torque_band_Nm,  ///< half the width of the band about an estimate
  force_band_N,
  following_error_m,    ///< commanded less actual
  following_error_rad,  ///< likewise
  command_current_A,
  command_torque_Nm,
  command_torque_percent,
  sound_Pa,  ///< sound pressure
};

inline constexpr std::array<std::string_view, 38> kQuantityNames = {"angle_rad",
                                                                    "angle_counts",
                                                                    "speed_rad_s",
                                                                    "position_m",
                                                                    "velocity_m_s",
                                                                    "acceleration_m_s2",
                                                                    "displacement_m",
                                                                    "command_angle_rad",
                                                                    "command_position_m",
                                                                    "command_velocity_m_s",
                                                                    "current_A",
                                                                    "torque_Nm",
                                                                    "force_N",
                                                                    "power_W",
                                                                    "load_V",
                                                                    "load_percent",
                                                                    "torque_percent",
                                                                    "current_percent",
                                                                    "voltage_V",
                                                                    "temperature_C",
                                                                    "feed_override",
                                                                    "feed_per_tooth_m",
                                                                    "nc_block",
                                                                    "force_x_N",
                                                                    "force_y_N",
                                                                    "force_z_N",
                                                                    "displacement_x_m",
                                                                    "displacement_y_m",
                                                                    "acceleration_x_m_s2",
                                                                    "acceleration_y_m_s2",
                                                                    "torque_band_Nm",
                                                                    "force_band_N",
                                                                    "following_error_m",
                                                                    "following_error_rad",
                                                                    "command_current_A",
                                                                    "command_torque_Nm",
                                                                    "command_torque_percent",
                                                                    "sound_Pa"};

[[nodiscard]] constexpr std::string_view name_of(Quantity quantity) noexcept {
  return kQuantityNames[static_cast<std::size_t>(quantity)];
}

[[nodiscard]] constexpr std::optional<Quantity> quantity_from(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kQuantityNames.size(); ++i)
    if (kQuantityNames[i] == name) return static_cast<Quantity>(i);
  return std::nullopt;
}

/// One column of a trace.
struct Signal {
  Channel channel = Channel::machine;
  Quantity quantity = Quantity::nc_block;
  friend constexpr bool operator==(const Signal&, const Signal&) = default;
};

}  // namespace servosense
