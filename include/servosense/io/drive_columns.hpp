// Which columns of a trace feed a drive: its motion and its effort.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {

/// Which columns of a trace feed one drive.
struct DriveColumns {
  DriveSignal signal;
  std::size_t motion_column = 0;
  std::size_t effort_column = 0;
  double constant_motion = 0;  ///< speed where no column tells it; 0 = motion_column does
};

/// What a machine file says about the columns of a drive.
struct ColumnChoice {
  std::string effort;          ///< name of the column; empty = as drive_columns() finds it
  double constant_motion = 0;  ///< speed where no column has the motion; 0 = none
};
/// `effort_column` of each drive, and `constant_speed_rpm` of the spindle.
struct ColumnChoices {
  ColumnChoice spindle;
  std::array<ColumnChoice, kAxes> axis;
};
[[nodiscard]] ColumnChoices column_choices(const MachineFile& machine);

/// The column that has the motion of `channel`, and what it counts in: counts before angle or
/// position before speed.
struct MotionColumn {
  std::size_t column = 0;
  MotionKind kind = MotionKind::counts;
};
std::optional<MotionColumn> motion_column(const std::vector<Signal>& signals, Channel channel);

/// The columns for `channel`: counts before angle or position before speed, current before torque
/// before force. Nothing when motion or effort is missing.
std::optional<DriveColumns> drive_columns(const std::vector<Signal>& signals, Channel channel,
                                          const ColumnChoice& choice = {});

/// The column of that name ("x.force_N").
[[nodiscard]] std::optional<std::size_t> column_named(const std::vector<Signal>& signals,
                                                      const std::string& name);

}  // namespace servosense
