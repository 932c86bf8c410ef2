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
  spindle2
};

inline constexpr std::array<std::string_view, 12> kChannelNames = {
    "spindle", "x", "y", "z", "a", "b", "c", "tool", "dyno", "hammer", "machine", "spindle2"};

[[nodiscard]] constexpr std::string_view name_of(Channel channel) noexcept {
  return kChannelNames[static_cast<std::size_t>(channel)];
}

[[nodiscard]] constexpr std::optional<Channel> channel_from(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kChannelNames.size(); ++i)
    if (kChannelNames[i] == name) return static_cast<Channel>(i);
  return std::nullopt;
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
};

inline constexpr std::array<std::string_view, 30> kQuantityNames = {"angle_rad",
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
                                                                    "acceleration_y_m_s2"};

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
