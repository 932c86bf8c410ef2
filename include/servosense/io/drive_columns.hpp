// Which columns of a trace feed a drive: its motion and its effort.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/motor_temperature.hpp"
#include "servosense/io/power_reading.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {

/// Which columns of a trace feed one drive.
struct DriveColumns {
  DriveSignal signal;
  std::size_t motion_column = 0;
  std::size_t effort_column = 0;
  std::optional<std::size_t> second_effort_column;  ///< of a gantry, to be added to the other
  std::optional<std::size_t> temperature_column;    ///< of the motor, where the effort is a current
  double constant_motion = 0;  ///< speed where no column tells it; 0 = motion_column does
  double motion_scale = 1;     ///< rad or m of the drive per unit of the column
  double effort_scale = 1;     ///< A, Nm or N per unit of the column: of a percentage
  bool is_angle = false;       ///< the column is an angle, which may begin anew with every turn
  /// The effort is a power, `effort_scale` W per unit of the column: this makes a torque of it.
  std::optional<PowerReading> power;
  /// rad/s beyond which the effort is a share of a torque that falls as 1/speed; 0: nowhere.
  double rated_to_rad_s = 0;
};

/// What a load in percent is of. `rating`: of the torque rated at the speed, which beyond base
/// speed is the rated power over the speed.
enum class LoadOf { unknown, power, torque, rating };

/// What a machine file says about the columns of a drive.
struct ColumnChoice {
  std::string effort;          ///< name of the column; empty = as drive_columns() finds it
  double constant_motion = 0;  ///< speed where no column has the motion; 0 = none
  double lead_m = 0;           ///< of a turn of the motor: makes its angle travel; 0 = not known
  // What it can be held against; 0 = not known.
  double unit_per_count = 0;  ///< rad or m
  unsigned counter_bits = 32;
  double max_speed = 0;  ///< rad/s or m/s
  double max_current_A = 0;
  bool effort_is_ratio = false;  ///< the effort has no unit
  double rated_torque_Nm = 0;    ///< of the motor: what a percentage is of; 0 = not known
  double rated_current_A = 0;    ///< likewise
  double rated_power_W = 0;      ///< likewise
  double load_meter_V_per_W = 0;
  LoadOf load_of = LoadOf::unknown;
  PowerReading power = {};
  ConstantOverTemperature constant = {};
  bool gantry = false;  ///< two motors move it
};
/// `effort_column` of each drive, `constant_speed_rpm` of a spindle, `lead_m` of the axes, and
/// what the machine file says of speeds, currents and the sample rate.
struct ColumnChoices {
  ColumnChoice spindle, spindle2;
  std::array<ColumnChoice, kAllAxes> axis;
  double sample_rate_hz = 0;  ///< 0 = not stated
  std::string machine;        ///< name of the file

  [[nodiscard]] const ColumnChoice& drive(Channel channel) const {
    return channel == Channel::spindle    ? spindle
           : channel == Channel::spindle2 ? spindle2
                                          : axis[axis_index(channel)];
  }
  [[nodiscard]] ColumnChoice& drive(Channel channel) {
    return const_cast<ColumnChoice&>(std::as_const(*this).drive(channel));
  }
};
[[nodiscard]] ColumnChoices column_choices(const MachineFile& machine);

/// The column that has the motion of `channel`, and what it counts in: counts before angle before
/// position before speed. The angle and the speed of an axis' motor need its lead.
struct MotionColumn {
  std::size_t column = 0;
  MotionKind kind = MotionKind::counts;
  double scale = 1;  ///< rad or m of the drive per unit of the column
};
std::optional<MotionColumn> motion_column(const std::vector<Signal>& signals, Channel channel,
                                          double lead_m = 0);

/// The columns for `channel`: counts before angle or position before speed, current before torque
/// before force, then a percentage of torque or current where the rated value is known, what the
/// drive is told to give, of a spindle last its power, load in volts or in percent where the
/// machine file says of what. Nothing when motion or effort is missing, of a gantry that of either
/// motor.
std::optional<DriveColumns> drive_columns(const std::vector<Signal>& signals, Channel channel,
                                          const ColumnChoice& choice = {});

/// The sentence for a drive whose effort is what it was told to give; empty where it is measured.
[[nodiscard]] std::string commanded_effort(const std::vector<Signal>& signals, Channel channel,
                                           const DriveColumns& columns);

/// What is said of a constant that goes with the temperature of a motor, where the trace does not
/// tell it or reports no current; empty where it does.
[[nodiscard]] std::string no_temperature(Channel channel, const DriveColumns& columns,
                                         const ConstantOverTemperature& constant);

/// What is left of the columns when these are used, for a reader: a sentence a drive that lacks
/// something, and one that names all others. Empty when every column is used.
[[nodiscard]] std::vector<std::string> unused_columns(const std::vector<Signal>& signals,
                                                      const std::vector<std::size_t>& used,
                                                      const ColumnChoices& choices = {});

/// The column of that name ("x.force_N").
[[nodiscard]] std::optional<std::size_t> column_named(const std::vector<Signal>& signals,
                                                      const std::string& name);

}  // namespace servosense
