// Tools and offsets as LinuxCNC keeps them: the tool table (.tbl) and the parameter file (.var).
//
// Lengths are millimetres in both files, as on a metric LinuxCNC machine.
#pragma once

#include <map>
#include <string>

#include "servosense/core/expected.hpp"
#include "servosense/process/program/canonical_move.hpp"

namespace servosense::process {

struct Tool {
  int number = 0;
  int pocket = 0;
  AxisPoint offset{};  ///< [m, deg]
  double diameter_m = 0;
  double front_angle_deg = 0, back_angle_deg = 0;
  int orientation = 0;  ///< of a lathe tool, 0 to 9
  std::string remark;
};

/// Tools by number. A line is `T1 P1 D6 Z10.5 ;remark`, with X to W, I, J and Q besides; blank
/// lines and lines that are a remark alone are passed over.
using ToolTable = std::map<int, Tool>;
/// Data error with FILE:LINE for a word that is none, a tool twice or no T.
Expected<ToolTable> read_tool_table(const std::string& path);
Expected<ToolTable> tool_table_of(std::string_view text, const std::string& name);

/// Numbered parameters of a .var file: a number and its value a line.
Expected<std::map<long, double>> read_parameter_file(const std::string& path);
Expected<std::map<long, double>> parameters_of(std::string_view text, const std::string& name);

}  // namespace servosense::process
