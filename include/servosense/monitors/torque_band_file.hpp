// Reference of the torque band monitor as a file: CSV with the columns program_s, torque_Nm,
// lower_Nm and upper_Nm, at equal distances of program time from 0 on. '#' begins a comment line.
#pragma once

#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/monitors/torque_band.hpp"

namespace servosense {

struct TorqueBandReference {
  double spacing_s = 0;
  std::vector<TorqueBandPoint<double>> points;
};

/// Data error, naming file and line, for a wrong header, values that are no numbers, times that do
/// not rise evenly from 0, a lower limit not below the upper one, fewer than two points.
Expected<TorqueBandReference> read_torque_band(LineReader& lines);
Expected<TorqueBandReference> read_torque_band(const std::string& path);

/// `comment`: one line, without the '#'.
Expected<Done> write_torque_band(const std::string& path, const TorqueBandReference& reference,
                                 const std::string& comment);

}  // namespace servosense
