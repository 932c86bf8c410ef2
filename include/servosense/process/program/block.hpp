// One line of an NC program: its words, G and M codes by modal group, and what it sets.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/process/program/expression.hpp"

namespace servosense::process {

enum class Dialect {
  linuxcnc,  ///< RS-274/NGC as LinuxCNC 2.9 reads it
  fanuc,     ///< the same codes, with IF, WHILE, GOTO and M98 as Fanuc's macro language has them
};

/// Of a block at most one code of each group is in force. Numbers as LinuxCNC's documentation has
/// them.
enum class GGroup : std::size_t {
  once = 0,
  motion = 1,
  plane = 2,
  distance = 3,
  arc_distance = 4,
  feed_mode = 5,
  units = 6,
  cutter_compensation = 7,
  tool_length = 8,
  retract = 10,
  coordinate_system = 12,
  path_control = 13,
  spindle_mode = 14,
  count = 15
};
enum class MGroup : std::size_t {
  stop,
  input_output,
  tool,
  spindle,
  coolant,
  override_switch,
  user,
  count
};

/// A G code is ten times its number: G91.1 is 911.
inline constexpr int kNoCode = -1;
[[nodiscard]] std::string code_name(int g_code);

struct Block {
  /// Words by their letter, `a` to `z`.
  std::array<std::optional<double>, 26> words;
  std::array<int, static_cast<std::size_t>(GGroup::count)> g;
  std::array<int, static_cast<std::size_t>(MGroup::count)> m;
  /// Polar coordinates, `@` and `^`; spindle `$`.
  std::optional<double> polar_radius, polar_angle_deg, spindle;
  std::string comment;  ///< the last one, without its parentheses
  struct Assignment {
    std::variant<long, std::string> parameter;
    double value = 0;
  };
  std::vector<Assignment> assignments;  ///< take effect once the line is read

  Block() { g.fill(kNoCode), m.fill(kNoCode); }
  [[nodiscard]] std::optional<double> word(char letter) const {
    return words[static_cast<std::size_t>(letter - 'a')];
  }
  [[nodiscard]] bool has(char letter) const { return word(letter).has_value(); }
  [[nodiscard]] bool has_any(std::string_view letters) const;
  [[nodiscard]] int code(GGroup group) const { return g[static_cast<std::size_t>(group)]; }
  [[nodiscard]] int code(MGroup group) const { return m[static_cast<std::size_t>(group)]; }
};

/// `line` without blanks and with small letters outside comments. Data error for a comment within a
/// comment or one that is not closed, and for a line that is too long.
Expected<std::string> tidy_line(std::string_view line);

/// Reads the words of a tidy line from the cursor on. Data errors say what is wrong, not where.
Expected<Block> read_block(Cursor& cursor, const ParameterValues& values);

}  // namespace servosense::process
