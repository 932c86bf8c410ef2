// servosense program check: what is wrong with an NC program, found by cutting it.
#include <algorithm>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "program_cut.hpp"
#include "program_moves.hpp"
#include "program_options.hpp"
#include "program_report.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/output_file.hpp"
#include "servosense/io/text.hpp"
#include "servosense/process/program/program_reader.hpp"
#include "servosense/process/tool/machine_tools.hpp"
#include "servosense/process/verification/program_check.hpp"
#include "servosense/process/verification/remainder.hpp"
#include "servosense/process/workpiece/stock.hpp"

namespace servosense::cli {
namespace {

using process::Finding;
using process::ProgramCheck;
using process::Workpiece;

/// What could not be looked at, and what it would take: "what: because".
std::vector<std::string> not_checked(const Arguments& arguments, const ProgramMoves& moves,
                                     process::MachineTools& tools,
                                     const process::CheckLimits& limits) {
  std::vector<std::string> all;
  const auto add = [&](const std::string& what, const std::string& because) {
    all.push_back(what + ": " + because);
  };
  const auto missing = [](double limit) { return limit == process::CheckLimits::kNone; };
  std::string axes;
  for (std::size_t i = 0; i < 3; ++i)
    if (missing(limits.travel_m[i][1])) axes += std::string(axes.empty() ? "" : ", ") + "xyz"[i];
  if (!axes.empty()) add("travel of " + axes, "[limits] travel_x_m and the like are not given");
  if (missing(limits.spindle_speed_rpm[1]))
    add("spindle speed", "[limits] spindle_speed_rpm is not given");
  if (missing(limits.spindle_start_s))
    add("cuts before the spindle has its speed", "[machine] spindle_start_s is not given");
  else if (limits.spindle_start_s > 0 && !moves.rapids_timed)
    add("cuts before the spindle has its speed",
        "[axis.*] max_velocity_m_s of x, y and z are not all given");
  if (missing(limits.feed_per_tooth_m))
    add("feed per tooth", "[limits] feed_per_tooth_m is not given");
  if (missing(limits.axial_depth_m)) add("depth", "[limits] axial_depth_m is not given");
  if (!arguments.value("--tools")) add("tool lengths", "no tool table (--tools)");
  if (arguments.all("--fixture").empty()) add("fixtures", "none is given (--fixture)");
  if (!arguments.value("--target")) add("gouges and remainder", "no target (--target)");
  for (const int number : moves.tools) {
    const auto tool = tools.of(number);
    if (!tool) continue;
    const std::string name = " of tool " + std::to_string(number);
    if (!(*tool)->holder) add("holder" + name, "stick_out_m and holder_diameter_m are not given");
    if (!(*tool)->shank) add("shank" + name, "flute_length_m is not given");
    if (!missing(limits.feed_per_tooth_m) && !(*tool)->teeth)
      add("feed per tooth" + name, "teeth is not given");
  }
  return all;
}

std::string where_of(const Finding& f) {
  if (f.line == 0) return "at the end";
  std::string text = "line " + std::to_string(f.line);
  if (f.last_line > f.line) text += " to " + std::to_string(f.last_line);
  return text;
}

void print_check(const Arguments& arguments, const std::string& name, const ProgramCheck& check,
                 const std::vector<Finding>& findings, const std::vector<std::string>& unchecked,
                 const ProgramMoves& moves) {
  if (!arguments.json()) {
    for (const std::string& text : unchecked) say("not checked: %s\n", text.c_str());
    for (const Finding& f : findings)
      say("%s:%s: %s (at x %.5g, y %.5g, z %.5g mm)\n", name.c_str(), where_of(f).c_str(),
          f.message.c_str(), 1e3 * f.position[0], 1e3 * f.position[1], 1e3 * f.position[2]);
    say("%s: %zu findings in %zu moves; %.6g mm3 removed\n", name.c_str(), findings.size(),
        check.moves(), check.removed_m3() * 1e9);
    return;
  }
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("program", name);
  json.objects("findings", findings, [&](const Finding& f) {
    if (f.line > 0)
      json.member("line", f.line);
    else
      json.member("line", nullptr);
    if (f.line > 0) json.member("last_line", f.last_line);
    json.member("kind", finding_name(f.kind));
    json.member("message", f.message);
    json.member("tool", f.tool);
    json.values("position_m", std::vector<double>(f.position.begin(), f.position.end()));
  });
  json.values("not_checked", unchecked);
  json.values("milling_direction_changes", check.direction_changes());
  json.member("removed_volume_m3", check.removed_m3());
  json.member("moves", check.moves());
  json.member("duration_s", moves.duration_s);
  json.member("accelerated", moves.accelerated);
  json.end_object();
  std::cout << '\n';
}

/// Fixtures and target, as lines.
Expected<Workpiece> solid_of(const std::string& text, double unit_m, double spacing_m) {
  const auto stock = process::read_stock(text, unit_m);
  if (!stock) return stock.error();
  return Workpiece::of(*stock, std::max(spacing_m, process::default_spacing_m(*stock, 1)),
                       Workpiece::Lines::upright);
}

int run_program_check(const Arguments& arguments) {
  const auto asked = asked_program(arguments, "program check");
  if (!asked) return fail(asked.error());
  const auto& [options, program] = *asked;
  const auto target_tolerance = arguments.positive("--target-tolerance");
  if (!target_tolerance) return fail(target_tolerance.error());
  const auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  const auto limits = process::CheckLimits::from(*machine);
  if (!limits) return fail(limits.error());
  const auto page = arguments.value("--report");
  if (page)
    if (const auto ok = check_writable(*page); !ok) return fail(ok.error());

  const auto motion = motion_of(arguments);
  if (!motion) return fail(motion.error());
  process::MachineTools tools(*machine);
  const auto moves = moves_of(program, options, *motion, tools);
  if (!moves) return fail(moves.error());
  Progress progress("cutting", arguments.quiet());
  auto stock = stock_of(arguments, options, tools, moves->smallest_radius_m, progress);
  if (!stock) return fail(stock.error());
  Workpiece& workpiece = stock->workpiece;

  ProgramCheck check(workpiece, tools, *limits);
  std::vector<std::unique_ptr<Workpiece>> solids;
  const auto add_solid = [&](const std::string& text) -> Expected<Workpiece*> {
    auto solid = solid_of(text, stock->mesh_unit_m, stock->spacing_m);
    if (!solid) return solid.error();
    solids.push_back(std::make_unique<Workpiece>(std::move(*solid)));
    return solids.back().get();
  };
  for (const std::string& text : arguments.all("--fixture")) {
    const auto fixture = add_solid(text);
    if (!fixture) return fail(fixture.error());
    check.add_fixture(**fixture);
  }
  const double tolerance_m = target_tolerance->value_or(process::kTargetTolerance);
  std::optional<Workpiece> target;
  if (const auto path = arguments.value("--target")) {
    const auto cut = add_solid(*path);
    if (!cut) return fail(cut.error());
    target = **cut;  // whole, for what is left on it
    check.set_target(**cut, tolerance_m);
  }
  if (options.tools) check.set_tool_table(*options.tools);
  check.set_times(moves->ends_s());
  std::optional<HeightPicture> before;
  CutHistory history;
  if (page) {
    before.emplace(workpiece);
    check.set_listener([&](const process::Engagement& e) {
      const auto tool = tools.of(e.tool);
      history.add(e, *moves, tool ? 2 * (*tool)->cutter.radius_m() : 0);
    });
  }
  const auto done = give_moves(program.name(), moves->asked, check, progress);
  if (!done) return fail(done.error());

  std::vector<Finding> findings = check.findings();
  if (target)
    if (auto left = finding_of(remainder_of(workpiece, *target, tolerance_m), tolerance_m))
      findings.push_back(std::move(*left));
  const auto unchecked = not_checked(arguments, *moves, tools, *limits);
  if (page) {
    const HeightPicture after(workpiece);
    const SidePicture front(workpiece, SidePicture::From::front);
    const SidePicture right(workpiece, SidePicture::From::right);
    ProgramPage content;
    content.title = "Program check";
    content.subtitle = program.name();
    content.before = &*before, content.after = &after;
    content.front = &front, content.right = &right;
    content.history = &history, content.findings = &findings, content.lines = &program.lines();
    content.not_checked = unchecked;
    const auto level = findings.empty() ? report::Level::none : report::Level::alarm;
    content.figures.figures = {
        {"findings", static_cast<double>(findings.size()), "", level},
        {"removed", check.removed_m3() * 1e9, "mm3"},
        {"moves", static_cast<double>(check.moves()), ""},
        {moves->accelerated ? "takes" : "takes, without acceleration", moves->duration_s, "s"}};
    if (const auto written = report_of(content).write(*page); !written)
      return fail(written.error());
  }
  print_check(arguments, program.name(), check, findings, unchecked, *moves);
  return !findings.empty() && arguments.has("--fail-on-finding") ? 1 : 0;
}

}  // namespace

Program program_check_program() {
  std::vector<Option> options = {
      {"--machine", "FILE", "its tools: [tool] or [tool.N]; [limits]; how fast the axes go", true,
       FileUse::input},
      {"--target", "STL", "what is to be left: gouges and remainder are found", false,
       FileUse::input},
      {"--target-tolerance", "M", "deviation from the target that is none [m] (0.05 mm)"},
      {"--fixture",
       "STOCK",
       "clamps, vice and table, given like the stock",
       false,
       FileUse::input,
       {},
       true},
      {"--report", "HTML", "page with pictures", false, FileUse::output},
      {"--fail-on-finding", "", "exit with status 1 when something was found"}};
  for (Option& option : stock_options()) options.push_back(std::move(option));
  for (Option& option : program_options()) options.push_back(std::move(option));
  return {{"program check", "what is wrong with an NC program, found by cutting it",
           std::move(options), "FILE",
           "Finds rapids through material, contact of holder, shank and fixtures, a spindle that "
           "stands or turns the\n"
           "wrong way in the cut, overtravel, wrong tool lengths, plunges and sideways cuts that a "
           "tool cannot make,\n"
           "too much feed per tooth or depth, gouges and remainder; by line, with what to do."},
          run_program_check};
}

}  // namespace servosense::cli
