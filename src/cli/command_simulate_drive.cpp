// servosense simulate drive: the drives of a machine file under their controllers.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <utility>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/sim/drive_motion.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::cli {
namespace {

/// Columns of one drive, and what goes into them.
struct Columns {
  const RunningDrive* drive;
  bool counts;
  bool truth;
  bool gantry;

  [[nodiscard]] std::vector<Signal> signals() const {
    using enum Quantity;
    const Channel c = drive->motion.channel;
    const bool turns = is_turning(c);
    const bool position = drive->motion.loop == DriveLoop::position;
    std::vector<Signal> s;
    if (!turns)
      s.push_back({c, position ? command_position_m : command_velocity_m_s});
    else if (position)
      s.push_back({c, command_angle_rad});
    s.push_back({c, counts ? angle_counts : turns ? angle_rad : position_m});
    s.push_back({c, current_A});
    if (gantry) s.push_back({second_motor_of(c), current_A});
    if (drive->motion.temperature_C) s.push_back({c, temperature_C});
    if (!truth) return s;
    if (counts) s.push_back({c, turns ? angle_rad : position_m});
    s.push_back({c, turns ? speed_rad_s : velocity_m_s});
    s.push_back({c, turns ? torque_Nm : force_N});
    if (is_spindle(c)) s.push_back({c, power_W});
    return s;
  }

  void put(const DriveSimSample& now, std::vector<TraceField>& row) const {
    const Channel c = drive->motion.channel;
    if (!is_turning(c) || drive->motion.loop == DriveLoop::position)
      row.push_back(TraceField::of(now.reference));
    row.push_back(counts ? TraceField::of_counts(now.angle_counts) : TraceField::of(now.position));
    for (int motor = 0; motor < (gantry ? 2 : 1); ++motor)
      row.push_back(now.current_is_new ? TraceField::of(now.current_A) : TraceField::none());
    if (drive->motion.temperature_C)
      row.push_back(TraceField::of(drive->motion.temperature_C(now.t_s)));
    if (!truth) return;
    if (counts) row.push_back(TraceField::of(now.position));
    row.push_back(TraceField::of(now.velocity));
    row.push_back(TraceField::of(now.effort));
    if (is_spindle(c)) row.push_back(TraceField::of(now.effort * now.velocity));
  }
};

/// What a reader wants to know of each drive at once.
struct Summary {
  double largest_current_A = 0;
  double largest_speed = 0;
  double largest_lag = 0;  // of the position behind its command
};

int run_simulate_drive(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  std::vector<std::string> remarks;
  auto motion = read_motion(arguments.at("--motion"), &remarks);
  if (!motion) return fail(motion.error());
  if (!arguments.quiet())
    for (const std::string& remark : remarks) note(remark);
  auto duration = arguments.positive("--duration");
  if (!duration) return fail(duration.error());
  const double duration_s = duration->value_or(motion->duration_s);

  const ColumnChoices choices = column_choices(*machine);
  std::vector<RunningDrive> drives;
  for (DriveMotion& part : motion->drives) {
    auto config = drive_simulation(*machine, part.channel);
    if (!config) return fail(config.error());
    auto talk = cross_talk_of(*machine, part.channel);
    if (!talk) return fail(talk.error());
    const ConstantOverTemperature constant = choices.drive(part.channel).constant;
    drives.push_back({std::move(*config), std::move(part), std::move(*talk), constant});
  }
  std::vector<Columns> columns;
  std::vector<Signal> signals;
  for (const RunningDrive& drive : drives) {
    const bool gantry = machine->flag(section_of(drive.motion.channel), "gantry").value_or(false);
    columns.push_back(
        {&drive, drive.config.encoder.counts_per_turn > 0, arguments.has("--truth"), gantry});
    const std::vector<Signal> own = columns.back().signals();
    signals.insert(signals.end(), own.begin(), own.end());
  }
  auto writer = TraceWriter::create(arguments.at("--out"), std::move(signals),
                                    {{"source", "servosense simulate drive"}});
  if (!writer) return fail(writer.error());

  Progress progress("simulating", arguments.quiet());
  std::vector<Summary> summaries(drives.size());
  std::vector<TraceField> row;
  std::size_t rows = 0;
  auto done = run_drives(
      drives, duration_s, [&](double t, std::span<const DriveSimSample> now) -> Expected<Done> {
        row.clear();
        for (std::size_t d = 0; d < now.size(); ++d) {
          columns[d].put(now[d], row);
          Summary& s = summaries[d];
          s.largest_current_A = std::max(s.largest_current_A, std::abs(now[d].current_A));
          s.largest_speed = std::max(s.largest_speed, std::abs(now[d].velocity));
          if (drives[d].motion.loop == DriveLoop::position)
            s.largest_lag = std::max(s.largest_lag, std::abs(now[d].reference - now[d].position));
        }
        if (++rows % 4096 == 0) progress.show(t / duration_s);
        return writer->write(static_cast<Nanoseconds>(std::llround(t * 1e9)), row);
      });
  if (!done) return fail(done.error());
  if (done = writer->close(); !done) return fail(done.error());

  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("out", arguments.at("--out"));
    json.member("rows", rows);
    json.member("duration_s", duration_s);
    json.key("drives");
    json.begin_array();
    for (std::size_t d = 0; d < drives.size(); ++d) {
      const bool turns = is_turning(drives[d].motion.channel);
      json.begin_object();
      json.member("channel", std::string_view(name_of(drives[d].motion.channel)));
      json.member("largest_current_A", summaries[d].largest_current_A);
      json.member(turns ? "largest_speed_rad_s" : "largest_velocity_m_s",
                  summaries[d].largest_speed);
      json.member(turns ? "largest_lag_rad" : "largest_lag_m", summaries[d].largest_lag);
      json.end_object();
    }
    json.end_array();
    json.end_object();
    std::cout << '\n';
  } else if (!arguments.quiet()) {
    for (std::size_t d = 0; d < drives.size(); ++d) {
      const bool turns = is_turning(drives[d].motion.channel);
      say("%s: up to %.4g %s and %.4g A\n", std::string(name_of(drives[d].motion.channel)).c_str(),
          summaries[d].largest_speed, turns ? "rad/s" : "m/s", summaries[d].largest_current_A);
    }
    say("%zu rows: %s\n", rows, arguments.at("--out").c_str());
  }
  return 0;
}

}  // namespace

Program simulate_drive_program() {
  return {
      {"simulate drive",
       "drives under cascade control, as a trace",
       {{"--machine", "FILE",
         "machine file with [spindle], [spindle2] or [axis.*], and [controller.*]", true,
         FileUse::input},
        {"--motion", "FILE", "trace with commands, or a program of moves", true, FileUse::input},
        {"--out", "TRACE", "trace to write", true, FileUse::output},
        {"--duration", "S", "seconds to simulate (all of the motion)", false},
        {"--truth", "",
         "also true motion, motor force and power of a spindle, which no drive reports", false}},
       "",
       "A program of moves has lines such as (m, rad, s, N, Nm):\n"
       "  x limits 0.5 5 100     velocity, acceleration and jerk\n"
       "  x move 0.1 0.2         to 0.1 m at 0.2 m/s\n"
       "  x dwell 0.5            stands still\n"
       "  x cruise 0.05 2        runs at 0.05 m/s for 2 s\n"
       "  x sine 0.001 5 10      10 cycles of 5 Hz\n"
       "  x load 100 1 2         cutting force of 100 N from 1 s to 2 s\n"
       "  sync                   all channels wait for the last one\n"
       "spindle, spindle2, a, b and c turn: rad and Nm.\n"
       "The force of a cut in a trace is dyno.force_x_N (y, z), or that on the tool with the\n"
       "opposite sign in tool.force_x_N; the torque is tool.torque_Nm."},
      run_simulate_drive};
}

}  // namespace servosense::cli
