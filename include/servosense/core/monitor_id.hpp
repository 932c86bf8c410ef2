// The monitors: who they are, and their names in the machine file and the event stream. A new one
// is one line in each of the two lists.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace servosense {

enum class MonitorId : std::uint8_t {
  chatter,
  collision,
  drill_fracture,
  ar_breakage,
  tooth_breakage,
  wear,
  torque_band,
  reference,
  cutting_coefficients,
  signal,  ///< the last: what counts the monitors counts up to it
};

inline constexpr std::size_t kMonitorCount = static_cast<std::size_t>(MonitorId::signal) + 1;

inline constexpr std::array<std::string_view, kMonitorCount> kMonitorNames = {
    "chatter", "collision",   "drill-fracture", "ar-breakage",          "tooth-breakage",
    "wear",    "torque-band", "reference",      "cutting-coefficients", "signal"};
static_assert(!kMonitorNames.back().empty(), "every monitor has a name");

/// Ends with a null character.
[[nodiscard]] constexpr const char* name_of(MonitorId id) noexcept {
  return kMonitorNames[static_cast<std::size_t>(id)].data();
}

[[nodiscard]] constexpr std::optional<MonitorId> monitor_from(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kMonitorCount; ++i)
    if (kMonitorNames[i] == name) return static_cast<MonitorId>(i);
  return std::nullopt;
}

}  // namespace servosense
