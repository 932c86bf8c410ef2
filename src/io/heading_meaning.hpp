// What the heading of a foreign column says: of which drive, which quantity, in which unit. Nothing
// is supposed: what is not understood stands in `unknown`.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/io/unit_name.hpp"

namespace servosense::detail {

/// What people name columns after.
enum class ColumnKind : std::uint8_t {
  time,
  date,
  position,
  speed,
  rotation,
  acceleration,
  current,
  torque,
  force,
  power,
  load,
  voltage,
  temperature,
  block,
  override_,
  counts
};
/// "a current", "a speed"
[[nodiscard]] std::string_view kind_name(ColumnKind kind);
/// Whether a quantity of that kind can have such a unit.
[[nodiscard]] bool kind_fits(ColumnKind kind, Dimension dimension);

/// What a word of a heading does.
enum class WordRole : std::uint8_t {
  spindle,
  second,    ///< makes the spindle the second one
  axis,      ///< value: the channel
  dyno,      ///< value: the channel that has forces of its own
  kind,      ///< value: the kind
  current_,  ///< English: a current, or "of now"
  symbol,    ///< a letter that stands for a kind, where its unit says so
  command,
  actual,
  statistic,  ///< mean, peak: not the value of an instant
  numbered,   ///< "axis 1": a drive, which one nobody knows
  counted,    ///< "channel 1": the number says nothing
  number,     ///< of a block; else nothing for a trace
  other,      ///< makes the column something that no trace has
  neutral
};
struct HeadingWord {
  std::string_view text;
  WordRole role;
  int value = 0;
};
/// The word of that spelling in lower case, umlauts written as ae, oe, ue, ss.
[[nodiscard]] const HeadingWord* heading_word(std::string_view text);

struct HeadingMeaning {
  std::string name;  ///< the heading without its unit
  std::string unit;  ///< as it stands there, or in the line of units; empty: not stated
  std::optional<UnitName> known_unit;
  std::optional<Channel> channel;
  std::optional<Channel> direction;  ///< x, y or z of a force on the tool or the dynamometer
  std::string channel_doubt;         ///< "axis 1", "x and y"
  std::vector<ColumnKind> kinds;     ///< several: the unit has to decide
  std::vector<ColumnKind> symbols;   ///< kinds that single letters may stand for
  bool command = false, actual = false, statistic = false, says_axis = false;
  std::string left_out;              ///< the word by which it is nothing for a trace
  std::vector<std::string> unknown;  ///< words that are not known
};
/// `unit_line`: what the line of units says of the column, or empty.
[[nodiscard]] HeadingMeaning meaning_of(std::string_view heading, std::string_view unit_line);

}  // namespace servosense::detail
