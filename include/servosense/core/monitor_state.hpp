// What a monitor says of its signal and the cut, and how files and other programs spell it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace servosense {

enum class MonitorState : std::uint8_t {
  idle,      ///< nothing to watch: the drive stands still, or the monitor has no threshold
  learning,  ///< windows and filters are filling, or a reference is being taught
  armed,
  warning,       ///< first level reached
  alarm,         ///< second level reached
  signal_fault,  ///< the signal cannot be trusted; no statement about the cut is made
};

inline constexpr std::array<std::string_view, 6> kMonitorStateNames = {
    "idle", "learning", "armed", "warning", "alarm", "signal-fault"};
static_assert(kMonitorStateNames.size() ==
              static_cast<std::size_t>(MonitorState::signal_fault) + 1);

/// Ends with a null character.
[[nodiscard]] constexpr const char* name_of(MonitorState state) noexcept {
  return kMonitorStateNames[static_cast<std::size_t>(state)].data();
}

[[nodiscard]] constexpr std::optional<MonitorState> monitor_state_from(
    std::string_view name) noexcept {
  for (std::size_t i = 0; i < kMonitorStateNames.size(); ++i)
    if (kMonitorStateNames[i] == name) return static_cast<MonitorState>(i);
  return std::nullopt;
}

}  // namespace servosense
