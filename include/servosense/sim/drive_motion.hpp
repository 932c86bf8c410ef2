// What drives are told to do, and a run of several drives together.
//
// A motion is read from a trace (its commands, else the motion it recorded) or from a program of
// jerk-limited moves, whose lines are (units m, rad, s, N, Nm; '#' begins a comment):
//   x limits VELOCITY ACCELERATION JERK      before the first motion of a channel
//   x start POSITION                         where it stands, 0 when not given
//   x move TARGET [FEED]                     from rest to rest
//   x cruise VELOCITY SECONDS                runs up, holds, runs down
//   x sine AMPLITUDE FREQUENCY CYCLES
//   x dwell SECONDS
//   x load FORCE FROM TO                     cutting force between two instants
//   x temperature FROM TO TIME_CONSTANT      of the motor, degC and s; acts by
//   torque_constant_per_K sync                                     all wait for the last one
// and the same with spindle, y, z, a, b, c and spindle2; VELOCITY in rad/s and so on where it
// turns.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/io/motor_temperature.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/sim/drive_simulator.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense {

/// One drive's part of a motion, as functions of time from the start.
struct DriveMotion {
  Channel channel = Channel::x;
  DriveLoop loop = DriveLoop::position;
  double initial_position = 0;                  ///< m or rad
  std::function<double(double)> reference;      ///< m, rad, m/s or rad/s
  std::function<double(double)> load;           ///< N or Nm against +motion; may be empty
  std::function<double(double)> temperature_C;  ///< of the motor; may be empty
};

struct Motion {
  double duration_s = 0;
  std::vector<DriveMotion> drives;
  std::vector<std::size_t> columns;  ///< of a trace: those that are used
};

/// Reads either kind of file: a trace begins with a header, whose first column is t_s. Data error
/// naming file and line.
/// `remarks`, where given, gets a sentence on the columns that are not used.
Expected<Motion> read_motion(const std::string& path, std::vector<std::string>* remarks = nullptr);

/// For each axis command_position_m, else command_velocity_m_s, else position_m or velocity_m_s;
/// for a spindle command_angle_rad, else speed_rad_s, else angle_rad; for an axis that turns
/// command_angle_rad, else angle_rad, else speed_rad_s. The load of an axis is
/// dyno.force_x_N (or y, z), else minus tool.force_x_N: the force on the tool is the reaction of
/// that on the work. That of the spindle is tool.torque_Nm, else dyno.torque_Nm; a trace has none
/// of the second spindle and of axes that turn. Straight lines
/// between rows; times count from the first. Data error for a trace that commands nothing or holds
/// no number in a column that is used.
Expected<Motion> motion_from_trace(const Trace& trace, const std::string& name);

/// Parses a program.
Expected<Motion> motion_from_program(LineReader& lines);

/// A drive that takes part in a run.
struct RunningDrive {
  DriveSimulatorConfig config;
  DriveMotion motion;
  std::vector<CrossTalk> cross_talk;  ///< from other drives of the run; others are passed over
  ConstantOverTemperature constant = {};
};

/// Steps all drives together for `duration_s`, and hands over their samples in the same order at
/// every servo instant. Cross-talk arrives one servo period late. Usage errors: those of
/// DriveSimulator, and drives of unequal servo rates; whatever error `sample` returns ends the run.
Expected<Done> run_drives(
    std::span<const RunningDrive> drives, double duration_s,
    const std::function<Expected<Done>(double t_s, std::span<const DriveSimSample>)>& sample);

}  // namespace servosense
