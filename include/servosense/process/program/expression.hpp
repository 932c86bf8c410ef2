// Numbers, parameters and expressions of an NC program, as LinuxCNC 2.9 evaluates them.
//
// A value is a number (sign, digits, point; no exponent), `#n`, `#<name>`, `[expression]`, a
// function with its argument in brackets, or any of these after a sign. Operators bind in the order
// `**`, then `* / MOD`, then `+ -`, then `EQ NE GT GE LT LE`, then `AND OR XOR`, all from the left
// (so 2**3**2 is 64). Angles are degrees. Equality is within kEqualNumbers.
#pragma once

#include <string>
#include <string_view>

#include "servosense/core/expected.hpp"

namespace servosense::process {

/// What `#n` and `#<name>` stand for. Data errors say what is wrong, not where.
class ParameterValues {
 public:
  virtual ~ParameterValues() = default;
  [[nodiscard]] virtual Expected<double> numbered(long index) const = 0;
  [[nodiscard]] virtual Expected<double> named(std::string_view name) const = 0;
  [[nodiscard]] virtual bool exists(std::string_view name) const = 0;
};

/// A place in a line that holds no blanks and no capitals outside comments.
struct Cursor {
  std::string_view line;
  std::size_t at = 0;

  [[nodiscard]] bool at_end() const { return at >= line.size(); }
  [[nodiscard]] char next() const { return at_end() ? '\0' : line[at]; }
  /// Goes on past `text` if it stands here.
  bool take(std::string_view text);
};

/// Any value. Data error without a place: what is wrong, and what would be right.
Expected<double> read_value(Cursor& cursor, const ParameterValues& values);
/// The same, `[` being the next character.
Expected<double> read_bracket(Cursor& cursor, const ParameterValues& values);
/// A whole number, within kEqualNumbers.
Expected<long> read_whole(Cursor& cursor, const ParameterValues& values);
/// `<name>`, without its brackets.
Expected<std::string> read_name(Cursor& cursor);

}  // namespace servosense::process
