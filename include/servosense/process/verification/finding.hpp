// What is wrong with an NC program, as the check of it tells.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "servosense/process/tool/sweep.hpp"

namespace servosense::process {

enum class FindingKind : std::uint8_t {
  rapid_into_material,
  holder_contact,
  shank_contact,
  fixture_contact,
  spindle_stopped,
  spindle_wrong_way,
  feed_before_spindle,
  spindle_not_at_speed,
  spindle_speed,
  overtravel,
  wrong_tool_length,
  plunge,
  drill_sideways,
  chip_load,
  depth,
  gouge,
  uncut_remainder,
};
inline constexpr std::size_t kFindingKinds = 17;
/// As in the report and in JSON: the words of the enumerator, with hyphens.
[[nodiscard]] std::string_view finding_name(FindingKind kind);

struct Finding {
  std::size_t line = 0;       ///< of the program; the first, where it goes on
  std::size_t last_line = 0;  ///< up to which it goes on
  FindingKind kind = FindingKind::rapid_into_material;
  int tool = 0;
  Point position{};     ///< of the tip, in the coordinates of the program [m]
  double size = 0;      ///< the greatest, in the unit that `message` has
  std::string message;  ///< what, how much, and what to do
};

}  // namespace servosense::process
