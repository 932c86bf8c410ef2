// The angle of a spindle at every row of a record, whatever column tells its motion.
#pragma once

#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/trace.hpp"

namespace servosense::cli {

struct SpindleAngle {
  std::vector<double> angle_rad;  ///< one a row, whole turns added up; between readings in between
  std::string remark;             ///< where no column tells it
};

/// Of the tool's spindle: its counts, angle or speed, else `[cut] spindle_speed_rpm`. Data error
/// naming what is missing.
Expected<SpindleAngle> spindle_angle(const std::vector<Signal>& signals,
                                     const std::vector<TraceRow>& rows, const MachineFile& machine,
                                     const std::string& path);

}  // namespace servosense::cli
