// What the effort of a drive is measured in: currents without a published scale are ratios, and a
// column of another kind (sound, vibration, load) keeps its own unit.
#pragma once

#include <string>
#include <string_view>
#include <utility>

#include "servosense/core/channel.hpp"
#include "servosense/io/machine_file.hpp"

namespace servosense::cli {

/// As printed: "Nm", "N", "ratio", "m/s2"...
[[nodiscard]] inline std::string effort_unit(const MachineFile& machine, Channel drive) {
  using namespace std::string_view_literals;
  const std::string_view section = section_of(drive);
  if (machine.flag(section, "current_is_ratio").value_or(false)) return "ratio";
  // Of the last part of a column's name; a current is turned into a torque or a force.
  const std::string column = machine.text(section, "effort_column").value_or("");
  for (const auto& [ending, unit] :
       {std::pair{"_m_s2"sv, "m/s2"sv}, std::pair{"_m_s"sv, "m/s"sv},
        std::pair{"_percent"sv, "%"sv}, std::pair{"_W"sv, "W"sv}, std::pair{"_V"sv, "V"sv},
        std::pair{"_m"sv, "m"sv}, std::pair{"_Nm"sv, "Nm"sv}, std::pair{"_N"sv, "N"sv}})
    if (column.ends_with(ending)) return std::string(unit);
  return is_turning(drive) ? "Nm" : "N";
}

/// `unit` to the power of two, or by another: "Nm2", "(m/s2)2", "N/s", "(m/s2) s/rad".
[[nodiscard]] inline std::string derived_unit(const std::string& unit, const char* by) {
  const bool whole = unit.find('/') == std::string::npos;
  return (whole ? unit : "(" + unit + ")") + by;
}

}  // namespace servosense::cli
