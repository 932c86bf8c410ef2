// A figure as it stands in a data sheet, "12 kg cm2", in the unit that a machine file wants.
#pragma once

#include <string>
#include <string_view>

#include "servosense/core/expected.hpp"
#include "servosense/io/unit_expression.hpp"

namespace servosense {

struct SheetValue {
  double value = 0;  ///< in the unit asked for, to 15 digits
  Amplitude amplitude = Amplitude::unsaid;
  std::string remark;  ///< what was made of it beyond a change of units: "4 counts a line"
};

/// Reads a number with a decimal point and, behind it, its unit; without one it is in `unit`, as
/// machine_keys.hpp spells units. For `unit` "counts" bits and lines of an encoder are taken, too.
/// A figure `per_turn` may say so: "10 mm/rev". Data error, to be put behind "expected ..., ", that
/// names what is wrong with the number or the unit.
[[nodiscard]] Expected<SheetValue> sheet_value_from(std::string_view text, std::string_view unit,
                                                    bool per_turn = false);

/// To 15 digits, so that 16 um are 1.6e-05 m.
[[nodiscard]] double to_15_digits(double value);

}  // namespace servosense
