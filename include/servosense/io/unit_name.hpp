// Units as people write them - data sheets, DBC files, headings of exports - and their value in the
// units of trace columns. One table for all readers.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/channel.hpp"

namespace servosense {

/// What a unit measures.
enum class Dimension : std::uint8_t {
  none,  ///< plain numbers: NC blocks
  time,
  angle,
  angular_speed,
  length,
  velocity,
  acceleration,
  current,
  torque,
  force,
  power,
  voltage,
  temperature,
  share,  ///< per cent
  counts,
  pressure
};

struct UnitName {
  std::string_view spelling;  ///< as the table has it: "1/min"
  Dimension dimension = Dimension::none;
  double value = 1;  ///< of one unit in SI units; of per cent and counts 1
};

/// The unit that `text` spells, UTF-8 or Latin-1: blanks, signs of powers and multiplication do not
/// matter, upper and lower case only where they tell two units apart ("nm" and "Nm").
[[nodiscard]] std::optional<UnitName> unit_named(std::string_view text);
/// The same among the units of one kind, so that "NM" is a torque.
[[nodiscard]] std::optional<UnitName> unit_named(std::string_view text, Dimension dimension);

/// `unit` with one sign of multiplication, powers without a sign of their own, and degree, micro,
/// square and minus spelled out: "kg*cm2" of "kg·cm²".
[[nodiscard]] std::string plain_unit_signs(std::string_view unit);

/// Spelling in the table of the unit nearest to `text`.
[[nodiscard]] std::string_view nearest_unit(std::string_view text);

[[nodiscard]] Dimension dimension_of(Quantity quantity);
/// The unit of a quantity in traces: "rad/s" of speed_rad_s; "" if it has none.
[[nodiscard]] std::string_view unit_of(Quantity quantity);
/// The value of one `unit`, such as "1/min" or "mA", in the unit of `quantity`; nothing if it is no
/// unit of that kind, or not known. Upper and lower case matter here.
[[nodiscard]] std::optional<double> value_of_unit(std::string_view unit, Quantity quantity);

}  // namespace servosense
