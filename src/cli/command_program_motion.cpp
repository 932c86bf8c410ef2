// servosense program motion: what an NC program asks of the machine, move by move.
#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>
#include <optional>
#include <set>
#include <string>

#include "commands.hpp"
#include "console.hpp"
#include "program_moves.hpp"
#include "program_options.hpp"
#include "row_file.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/text.hpp"
#include "servosense/process/program/program_reader.hpp"

namespace servosense::cli {
namespace {

using process::CanonicalMove;
using Kind = CanonicalMove::Kind;

constexpr const char* kMotionColumns = "line,t_s,kind,x_m,y_m,z_m,feed_m_s,spindle_rpm,tool";

void put_row(RowFile& file, const CanonicalMove& move, double t_s, std::string_view kind,
             const process::AxisPoint& at) {
  std::string& text = file.row();
  append_integer(text, static_cast<std::int64_t>(move.line));
  text += ',';
  append_number(text, t_s);
  text += ',';
  text += kind;
  for (std::size_t i = 0; i < 3; ++i) {
    text += ',';
    append_number(text, at[i] == 0 ? 0 : at[i]);
  }
  text += ',';
  append_number(text, move.feed_m_s);
  text += ',';
  append_number(text, move.spindle_rpm == 0 ? 0 : move.spindle_rpm);
  text += ',';
  append_integer(text, move.tool);
  file.end_row();
}

struct MotionSummary {
  std::size_t moves = 0;
  double cutting_m = 0, duration_s = 0;
  std::set<int> tools;
  std::optional<std::array<std::array<double, 2>, 3>> bounds;  // of x, y, z: least, greatest

  void add(const CanonicalMove& move, const process::AxisPoint& from) {
    if (move.kind == Kind::arc) {
      cutting_m += path_length(move, move.begin);
    } else if (move.kind != Kind::rapid && move.feed_m_s > 0) {
      CanonicalMove straight = move;
      straight.end = move.machine;
      cutting_m += (move.kind == Kind::tap ? 2 : 1) * path_length(straight, from);
    }
    const process::AxisPoint& at = move.end;
    if (!bounds) bounds = {{{at[0], at[0]}, {at[1], at[1]}, {at[2], at[2]}}};
    for (std::size_t i = 0; i < 3; ++i) {
      (*bounds)[i][0] = std::min((*bounds)[i][0], at[i]);
      (*bounds)[i][1] = std::max((*bounds)[i][1], at[i]);
    }
  }
};

int run_program_motion(const Arguments& arguments) {
  const auto asked = asked_program(arguments, "program motion");
  if (!asked) return fail(asked.error());
  const auto& [options, program] = *asked;
  const auto motion = motion_of(arguments);
  if (!motion) return fail(motion.error());
  const bool accelerated = motion->unknown_acceleration.empty();
  auto file = RowFile::asked(arguments, kMotionColumns);
  if (!file) return fail(file.error());
  std::optional<RowFile>& table = *file;
  MotionSummary summary;
  process::AxisPoint stands{}, machine{};
  const auto row = [&](const CanonicalMove& move, double t_s, std::string_view kind,
                       const process::AxisPoint& at) {
    ++summary.moves;
    if (table) put_row(*table, move, t_s, kind, at);
  };
  double before_s = 0;
  std::size_t without_spindle = 0;
  const auto duration =
      timed(program, options, *motion, [&](const CanonicalMove& move, double t_s) {
        if (move.kind == Kind::tool) summary.tools.insert(move.tool);
        if (is_motion(move.kind)) summary.add(move, machine);
        without_spindle += is_motion(move.kind) && move.feed_m_rev > 0 && move.spindle_rpm == 0;
        if (move.kind == Kind::tap) {  // there and back
          row(move, (before_s + t_s) / 2, "feed", move.end);
          CanonicalMove back = move;
          back.spindle_rpm = -move.spindle_rpm;
          row(back, t_s, "feed", stands);
        } else if (is_motion(move.kind) || move.kind == Kind::dwell || move.kind == Kind::tool) {
          row(move, t_s, kind_name(move.kind), move.end);
          stands = move.end;
          machine = move.machine;
        }
        before_s = t_s;
      });
  if (!duration) return fail(duration.error());
  summary.duration_s = *duration;
  if (table)
    if (const auto written = table->finish(); !written) return fail(written.error());
  if (!options.tools)
    note("no tool table was given (--tools): tools have no length", arguments.quiet());
  say_what_is_unknown(*motion, arguments.quiet());
  if (without_spindle > 0)
    note(std::to_string(without_spindle) +
             " moves have a feed a revolution while the spindle stands: their time is that of the "
             "programmed speed; a machine waits",
         arguments.quiet());
  if (accelerated && !summary.tools.empty() && !(motion->limits.tool_change_s > 0))
    note("tool changes take no time (tool_change_s of [machine])", arguments.quiet());
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("program", program.name());
    json.member("moves", summary.moves);
    json.member("duration_s", summary.duration_s);
    json.member("accelerated", accelerated);
    json.member("feed_path_m", summary.cutting_m);
    json.values("tools", std::vector<int>(summary.tools.begin(), summary.tools.end()));
    if (summary.bounds)
      for (std::size_t i = 0; i < 3; ++i)
        json.values(std::string(1, "xyz"[i]) + "_m", (*summary.bounds)[i]);
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  say("%s: %zu moves, %.6g m at feed, %.6g s %s acceleration\n", program.name().c_str(),
      summary.moves, summary.cutting_m, summary.duration_s, accelerated ? "with" : "without");
  if (summary.bounds)
    for (std::size_t i = 0; i < 3; ++i)
      say("  %c from %.6g to %.6g mm\n", "xyz"[i], (*summary.bounds)[i][0] * 1e3,
          (*summary.bounds)[i][1] * 1e3);
  return 0;
}

}  // namespace

Program program_motion_program() {
  std::vector<Option> options = {
      {"--out", "CSV", "table of the moves", false, FileUse::output},
      {"--machine", "FILE",
       "how the axes go: [axis.*] max_velocity_m_s, max_acceleration_m_s2, max_jerk_m_s3", false,
       FileUse::input}};
  for (Option& option : program_options()) options.push_back(std::move(option));
  return {
      {"program motion", "an NC program, move by move", std::move(options), "FILE",
       "Points are those of LinuxCNC's canonical output: coordinates of the program, work offset "
       "and tool length\n"
       "taken off. A line that is wrong or not supported is refused; none is passed over. Times "
       "are those of a\n"
       "control with LinuxCNC's look-ahead and blending where every axis has its "
       "max_acceleration_m_s2, else those of a\n"
       "machine without inertia. A tool change takes [machine] tool_change_s, the spindle "
       "spindle_start_s if\n"
       "waits_for_spindle; coolant and operator take none."},
      run_program_motion};
}

}  // namespace servosense::cli
