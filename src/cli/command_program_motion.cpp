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
#include "program_options.hpp"
#include "row_file.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/text.hpp"
#include "servosense/process/motion/plain_time.hpp"
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

  void add(const process::AxisPoint& at) {
    if (!bounds) bounds = {{{at[0], at[0]}, {at[1], at[1]}, {at[2], at[2]}}};
    for (std::size_t i = 0; i < 3; ++i) {
      (*bounds)[i][0] = std::min((*bounds)[i][0], at[i]);
      (*bounds)[i][1] = std::max((*bounds)[i][1], at[i]);
    }
  }
};

int run_program_motion(const Arguments& arguments) {
  if (arguments.operands().size() != 1)
    return fail(usage_error("program motion reads one program; name it"));
  const auto options = program_options_of(arguments);
  if (!options) return fail(options.error());
  process::RapidLimits limits;
  std::string unknown_speed = "xyz";
  if (const auto path = arguments.value("--machine")) {
    const auto machine = MachineFile::read(*path);
    if (!machine) return fail(machine.error());
    unknown_speed.clear();
    for (std::size_t i = 0; i < 3; ++i) {
      const std::string axis(1, "xyz"[i]);
      if (const auto speed = machine->number("axis." + axis, "max_velocity_m_s"))
        limits.velocity_m_s[i] = *speed;
      else
        unknown_speed += axis;
    }
  }
  const auto program = process::ProgramText::read(arguments.operands()[0]);
  if (!program) return fail(program.error());
  std::optional<RowFile> table;
  if (const auto out = arguments.value("--out")) {
    auto file = OutputFile::open(*out);
    if (!file) return fail(file.error());
    table.emplace(std::move(*file), kMotionColumns);
  }
  MotionSummary summary;
  process::AxisPoint stands{};
  const auto row = [&](const CanonicalMove& move, double t_s, std::string_view kind,
                       const process::AxisPoint& at) {
    ++summary.moves;
    if (table) put_row(*table, move, t_s, kind, at);
  };
  double before_s = 0;
  process::PlainTime time(limits, [&](const CanonicalMove& move, double t_s) {
    if (move.kind == Kind::tool) summary.tools.insert(move.tool);
    if (is_motion(move.kind)) summary.add(move.end);
    if (move.kind == Kind::feed || move.kind == Kind::arc)
      summary.cutting_m += (t_s - before_s) * move.feed_m_s;
    if (move.kind == Kind::tap) {  // there and back
      row(move, (before_s + t_s) / 2, "feed", move.end);
      CanonicalMove back = move;
      back.spindle_rpm = -move.spindle_rpm;
      row(back, t_s, "feed", stands);
    } else if (is_motion(move.kind) || move.kind == Kind::dwell || move.kind == Kind::tool) {
      row(move, t_s, kind_name(move.kind), move.end);
      stands = move.end;
    }
    before_s = t_s;
  });
  const auto done =
      process::run_program(*program, *options, [&](const CanonicalMove& move) { time.put(move); });
  if (!done) return fail(done.error());
  time.finish();
  summary.duration_s = time.now_s();
  if (table)
    if (const auto written = table->finish(); !written) return fail(written.error());
  if (!options->tools)
    note("no tool table was given (--tools): tools have no length", arguments.quiet());
  if (!unknown_speed.empty())
    note("how fast " + unknown_speed +
             " can go is not known ([axis.*] max_velocity_m_s): there rapids take no time",
         arguments.quiet());
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("program", program->name());
    json.member("moves", summary.moves);
    json.member("duration_s", summary.duration_s);
    json.member("feed_path_m", summary.cutting_m);
    json.values("tools", std::vector<int>(summary.tools.begin(), summary.tools.end()));
    if (summary.bounds)
      for (std::size_t i = 0; i < 3; ++i)
        json.values(std::string(1, "xyz"[i]) + "_m", (*summary.bounds)[i]);
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  say("%s: %zu moves, %.6g m at feed, %.6g s without acceleration\n", program->name().c_str(),
      summary.moves, summary.cutting_m, summary.duration_s);
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
      {"--machine", "FILE", "how fast the axes go: [axis.*] max_velocity_m_s", false,
       FileUse::input}};
  for (Option& option : program_options()) options.push_back(std::move(option));
  return {
      {"program motion", "an NC program, move by move", std::move(options), "FILE",
       "Points are those of LinuxCNC's canonical output: coordinates of the program, work offset "
       "and tool length\n"
       "taken off. A line that is wrong or not supported is refused; none is passed over. Times "
       "are those of a\n"
       "machine without inertia."},
      run_program_motion};
}

}  // namespace servosense::cli
