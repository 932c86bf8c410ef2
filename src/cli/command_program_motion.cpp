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
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/output_file.hpp"
#include "servosense/io/text.hpp"
#include "servosense/process/motion/plain_time.hpp"
#include "servosense/process/motion/trajectory.hpp"
#include "servosense/process/program/program_reader.hpp"

namespace servosense::cli {
namespace {

using process::CanonicalMove;
using Kind = CanonicalMove::Kind;

/// Rows of the table, written as they come.
class MotionTable {
 public:
  explicit MotionTable(OutputFile file) : file_(std::move(file)) {
    text_ = "line,t_s,kind,x_m,y_m,z_m,feed_m_s,spindle_rpm,tool\n";
  }

  void put(const CanonicalMove& move, double t_s, std::string_view kind,
           const process::AxisPoint& at) {
    append_integer(text_, static_cast<std::int64_t>(move.line));
    text_ += ',';
    append_number(text_, t_s);
    text_ += ',';
    text_ += kind;
    for (std::size_t i = 0; i < 3; ++i) {
      text_ += ',';
      append_number(text_, at[i] == 0 ? 0 : at[i]);
    }
    text_ += ',';
    append_number(text_, move.feed_m_s);
    text_ += ',';
    append_number(text_, move.spindle_rpm == 0 ? 0 : move.spindle_rpm);
    text_ += ',';
    append_integer(text_, move.tool);
    text_ += '\n';
    if (text_.size() > kChunk) write();
  }
  Expected<Done> finish() {
    write();
    if (failure_) return *failure_;
    return file_.commit();
  }

 private:
  static constexpr std::size_t kChunk = std::size_t{1} << 16U;
  void write() {
    if (!failure_)
      if (const auto done = file_.write(text_); !done) failure_ = done.error();
    text_.clear();
  }

  OutputFile file_;
  std::string text_;
  std::optional<Error> failure_;
};

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

Expected<process::ProgramOptions> options_of(const Arguments& arguments) {
  process::ProgramOptions options;
  const std::string dialect = arguments.value("--dialect").value_or("linuxcnc");
  if (dialect == "fanuc")
    options.dialect = process::Dialect::fanuc;
  else if (dialect != "linuxcnc")
    return usage_error("--dialect is linuxcnc or fanuc, not " + in_quotes(dialect));
  options.block_delete = arguments.has("--block-delete");
  if (const auto path = arguments.value("--tools")) {
    auto tools = process::read_tool_table(*path);
    if (!tools) return tools.error();
    options.tools = std::move(*tools);
  }
  if (const auto path = arguments.value("--parameters")) {
    auto parameters = process::read_parameter_file(*path);
    if (!parameters) return parameters.error();
    options.parameters = std::move(*parameters);
  }
  return options;
}

/// Of the machine file and of what the operator turns.
Expected<process::MachineMotion> motion_of(const Arguments& arguments) {
  process::MachineMotion motion{{}, "xyz", "xyz"};
  if (const auto path = arguments.value("--machine")) {
    const auto machine = MachineFile::read(*path);
    if (!machine) return machine.error();
    motion = process::machine_motion(*machine);
  }
  for (const auto& [name, share] : {std::pair{"--feed-override", &motion.limits.feed_override},
                                    std::pair{"--rapid-override", &motion.limits.rapid_override}}) {
    const auto percent = arguments.within(name, 1, 300, "percent");
    if (!percent) return percent.error();
    if (*percent) *share = **percent / 100;
  }
  return motion;
}

/// Gives every move and the time of its end to `sink`, with acceleration if that is known.
template <class Sink>
Expected<double> timed(const process::ProgramText& program, const process::ProgramOptions& options,
                       const process::MachineMotion& motion, const Sink& sink) {
  const auto run = [&](auto&& time) -> Expected<double> {
    const auto done =
        process::run_program(program, options, [&](const CanonicalMove& move) { time.put(move); });
    if (!done) return done.error();
    time.finish();
    return time.now_s();
  };
  if (motion.unknown_acceleration.empty())
    return run(process::TrajectoryPlanner(motion.limits, sink));
  return run(process::PlainTime(motion.limits, sink));
}

void say_what_is_unknown(const process::MachineMotion& motion, const Arguments& arguments) {
  if (!motion.unknown_velocity.empty())
    note("how fast " + motion.unknown_velocity +
             " can go is not known ([axis.*] max_velocity_m_s): there rapids take no time" +
             (motion.unknown_acceleration.empty() ? " but acceleration" : ""),
         arguments.quiet());
  const auto known = 3 - motion.unknown_acceleration.size();
  if (known > 0 && known < 3)
    note("how hard " + motion.unknown_acceleration +
             " can accelerate is not known ([axis.*] max_acceleration_m_s2): times are without "
             "acceleration",
         arguments.quiet());
}

int run_program_motion(const Arguments& arguments) {
  if (arguments.operands().size() != 1)
    return fail(usage_error("program motion reads one program; name it"));
  const auto options = options_of(arguments);
  if (!options) return fail(options.error());
  const auto motion = motion_of(arguments);
  if (!motion) return fail(motion.error());
  const bool accelerated = motion->unknown_acceleration.empty();
  const auto program = process::ProgramText::read(arguments.operands()[0]);
  if (!program) return fail(program.error());
  std::optional<MotionTable> table;
  if (const auto out = arguments.value("--out")) {
    auto file = OutputFile::open(*out);
    if (!file) return fail(file.error());
    table.emplace(std::move(*file));
  }
  MotionSummary summary;
  process::AxisPoint stands{}, machine{};
  const auto row = [&](const CanonicalMove& move, double t_s, std::string_view kind,
                       const process::AxisPoint& at) {
    ++summary.moves;
    if (table) table->put(move, t_s, kind, at);
  };
  double before_s = 0;
  std::size_t without_spindle = 0;
  const auto duration =
      timed(*program, *options, *motion, [&](const CanonicalMove& move, double t_s) {
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
  if (!options->tools)
    note("no tool table was given (--tools): tools have no length", arguments.quiet());
  say_what_is_unknown(*motion, arguments);
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
    json.member("program", program->name());
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
  say("%s: %zu moves, %.6g m at feed, %.6g s %s acceleration\n", program->name().c_str(),
      summary.moves, summary.cutting_m, summary.duration_s, accelerated ? "with" : "without");
  if (summary.bounds)
    for (std::size_t i = 0; i < 3; ++i)
      say("  %c from %.6g to %.6g mm\n", "xyz"[i], (*summary.bounds)[i][0] * 1e3,
          (*summary.bounds)[i][1] * 1e3);
  return 0;
}

}  // namespace

Program program_motion_program() {
  return {
      {"program motion",
       "an NC program, move by move",
       {{"--out", "CSV", "table of the moves", false, FileUse::output},
        {"--tools", "FILE", "tool table of LinuxCNC (.tbl), millimetres", false, FileUse::input},
        {"--parameters", "FILE", "parameters of LinuxCNC (.var), work offsets among them", false,
         FileUse::input},
        {"--machine", "FILE",
         "how the axes go: [axis.*] max_velocity_m_s, max_acceleration_m_s2, max_jerk_m_s3", false,
         FileUse::input},
        {"--feed-override", "PERCENT", "of feeds not bound to the spindle (100)"},
        {"--rapid-override", "PERCENT", "of rapids (100)"},
        {"--dialect", "NAME", "linuxcnc or fanuc (linuxcnc)"},
        {"--block-delete", "", "leaves out lines that begin with '/'"}},
       "FILE",
       "Points are those of LinuxCNC's canonical output: coordinates of the program, work offset "
       "and tool length\n"
       "taken off. A line that is wrong or not supported is refused; none is passed over. Times "
       "are those of a\n"
       "control with LinuxCNC's look-ahead and blending where every axis has its "
       "max_acceleration_m_s2, else those of a\n"
       "machine without inertia. A tool change takes [machine] tool_change_s; spindle, coolant "
       "and operator take none."},
      run_program_motion};
}

}  // namespace servosense::cli
