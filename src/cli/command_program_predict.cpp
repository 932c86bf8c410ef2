// servosense program predict: what an NC program removes, where the cutter meets the part, and what
// torque and force that asks for.
#include <algorithm>
#include <cmath>
#include <iostream>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "changed_cuts.hpp"
#include "commands.hpp"
#include "console.hpp"
#include "program_cut.hpp"
#include "program_loads.hpp"
#include "program_moves.hpp"
#include "program_options.hpp"
#include "row_file.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/text.hpp"
#include "servosense/process/engagement/chip_load.hpp"
#include "servosense/process/engagement/program_engagement.hpp"
#include "servosense/process/engagement/turning_tools.hpp"
#include "servosense/process/program/program_reader.hpp"
#include "servosense/process/tool/machine_tools.hpp"

namespace servosense::cli {
namespace {

using process::CanonicalMove;
using process::Engagement;

constexpr const char* kPredictColumns =
    "line,t_s,removed_m3,axial_depth_m,radial_immersion_m,entry_deg,exit_deg,contact_m2,"
    "spindle.torque_Nm,low_Nm,high_Nm,bottom_m2,least_chip_m,greatest_chip_m,tool,arcs_deg,"
    "spindle_rpm,feed_per_tooth_m,removed_m2,spindle.peak_Nm,harmonic_1_Nm,harmonic_2_Nm,"
    "harmonic_3_Nm,runout_Nm,spindle.power_W,force_x_N,force_y_N,force_z_N,deflection_x_m,"
    "deflection_y_m,least_force_x_N,greatest_force_x_N,least_force_y_N,greatest_force_y_N,"
    "least_force_z_N,greatest_force_z_N,wider_Nm,higher_Nm";

void put_row(RowFile& file, const Engagement& e, const MoveTechnology& t,
             const process::StepConditions& conditions, const process::StepLoad& load,
             ChangedCuts& changed) {
  std::string& text = file.row();
  const auto number = [&](double value) {
    text += ',';
    append_number(text, value);
  };
  const auto angles = entry_exit(e, t.clockwise());
  append_integer(text, static_cast<std::int64_t>(e.line));
  number(t.begin_s + (t.end_s - t.begin_s) * e.to_share);
  for (const double value : {e.removed_m3, e.axial_depth_m, e.radial_immersion_m, angles.entry_deg,
                             angles.exit_deg, e.side_m2})
    number(value);
  for (const double value : {load.torque_Nm, load.low_Nm, load.high_Nm}) number(value);
  number(e.bottom_m2);
  const bool contact = e.greatest_chip > 0;
  number(contact ? e.least_chip * t.feed_per_tooth_m : 0);
  number(contact ? e.greatest_chip * t.feed_per_tooth_m : 0);
  text += ',';
  append_integer(text, e.tool);
  text += ',';
  for (std::size_t i = 0; i < e.arcs.size(); ++i) {
    if (i > 0) text += ' ';
    append_number(text, e.arcs[i].from_deg);
    text += ':';
    append_number(text, e.arcs[i].to_deg);
  }
  for (const double value : {t.spindle_rpm, conditions.feed_per_tooth_m,
                             process::step_areas(e).removed_m2, load.peak_Nm})
    number(value);
  for (const double value : load.harmonic_Nm) number(value);
  for (const double value : {load.runout_Nm, load.power_W}) number(value);
  for (const double value : load.force_N) number(value);
  for (const double value : load.deflection_m) number(value);
  for (std::size_t i = 0; i < load.force_N.size(); ++i)
    number(load.least_force_N[i]), number(load.greatest_force_N[i]);
  const double lasts_s = t.end_s - t.begin_s;
  for (std::optional<TorqueCourse>* course : {&changed.wider, &changed.higher})
    number(*course ? (*course)->mean_Nm(t.begin_s + lasts_s * e.from_share,
                                        t.begin_s + lasts_s * e.to_share)
                   : process::kNoAngle);
  file.end_row();
}

struct Prediction {
  ProgramMoves moves;
  std::size_t steps = 0, thin = 0;
  double removed_m3 = 0, error_m3 = 0, spacing_m = 0;
  double greatest_depth_m = 0, greatest_width_m = 0;
  std::set<int> tools;
  std::set<std::size_t> rapid_lines, holder_lines;
  LoadSummary load;

  void add(const Engagement& e) {
    ++steps;
    thin += e.thin ? 1 : 0;
    greatest_depth_m = std::max(greatest_depth_m, e.axial_depth_m);
    greatest_width_m = std::max(greatest_width_m, e.radial_immersion_m);
    if (e.cuts()) tools.insert(e.tool);
    if (e.rapid && e.cuts()) rapid_lines.insert(e.line);
    if (e.holder_m3 > 0) holder_lines.insert(e.line);
  }
};

void print_prediction(const Arguments& arguments, const Prediction& p, const std::string& name) {
  if (!arguments.json()) {
    say("%s: %.6g mm3 removed, known to %.2g, in %zu steps and %.6g s %s acceleration\n",
        name.c_str(), p.removed_m3 * 1e9, p.error_m3 * 1e9, p.steps, p.moves.duration_s,
        p.moves.accelerated ? "with" : "without");
    say("  at most %.4g mm deep and %.4g mm wide, by lines %.3g mm apart\n",
        p.greatest_depth_m * 1e3, p.greatest_width_m * 1e3, p.spacing_m * 1e3);
    p.load.say_greatest();
    for (const std::size_t line : p.rapid_lines) say("  line %zu: a rapid cuts\n", line);
    for (const std::size_t line : p.holder_lines)
      say("  line %zu: the holder meets the part\n", line);
    return;
  }
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("program", name);
  json.member("steps", p.steps);
  json.member("duration_s", p.moves.duration_s);
  json.member("accelerated", p.moves.accelerated);
  json.member("removed_volume_m3", p.removed_m3);
  json.member("removed_volume_error_m3", p.error_m3);
  json.member("spacing_m", p.spacing_m);
  json.member("greatest_axial_depth_m", p.greatest_depth_m);
  json.member("greatest_radial_immersion_m", p.greatest_width_m);
  json.values("tools", std::vector<int>(p.tools.begin(), p.tools.end()));
  json.values("rapid_lines", std::vector<std::size_t>(p.rapid_lines.begin(), p.rapid_lines.end()));
  json.values("holder_lines",
              std::vector<std::size_t>(p.holder_lines.begin(), p.holder_lines.end()));
  p.load.write(json);
  json.end_object();
  std::cout << '\n';
}

int run_program_predict(const Arguments& arguments) {
  const auto asked = asked_program(arguments, "program predict");
  if (!asked) return fail(asked.error());
  const auto& [options, program] = *asked;
  const auto machine = machine_with_coefficients(arguments);
  if (!machine) return fail(machine.error());
  const auto tolerance_m = arguments.positive("--stock-tolerance");
  if (!tolerance_m) return fail(tolerance_m.error());
  auto file = RowFile::asked(arguments, kPredictColumns);
  if (!file) return fail(file.error());
  std::optional<RowFile>& table = *file;

  const auto motion = motion_of(arguments);
  if (!motion) return fail(motion.error());
  process::MachineTools tools(*machine);
  Prediction p;
  auto moves = moves_of(program, options, *motion, tools);
  if (!moves) return fail(moves.error());
  p.moves = std::move(*moves);
  Progress progress("cutting", arguments.quiet());
  auto stock = stock_of(arguments, options, tools, p.moves.smallest_radius_m, progress);
  if (!stock) return fail(stock.error());
  p.spacing_m = stock->spacing_m;
  ProgramLoads loads(*machine, tolerance_m->value_or(0));
  if (const auto known = loads.look_up(p.moves.tools); !known) return fail(known.error());
  p.load.lacks = loads.lacks();
  ChangedCuts changed;
  if (table && p.load.lacks.size() < p.moves.tools.size()) {
    auto cut = changed_cuts(*machine, p.moves, stock->workpiece, program.name(), progress);
    if (!cut) return fail(cut.error());
    changed = *std::move(cut);
  }
  process::ProgramEngagement engagement(stock->workpiece, process::cutters_of(tools),
                                        [&](const Engagement& e) {
                                          p.add(e);
                                          const MoveTechnology& t = p.moves.moves[e.move];
                                          const auto conditions = loads.conditions(e, t);
                                          const auto load = loads.of(e, conditions);
                                          p.load.add(e, load);
                                          if (table)
                                            put_row(*table, e, t, conditions, load, changed);
                                        });
  const auto done = give_moves(program.name(), p.moves.asked, engagement, progress);
  if (!done) return fail(done.error());
  p.removed_m3 = engagement.removed_m3();
  p.error_m3 = engagement.removed_error_m3();
  if (table)
    if (const auto written = table->finish(); !written) return fail(written.error());

  const bool quiet = arguments.quiet();
  say_what_is_unknown(*motion, quiet);
  for (const std::string& text : loads.remarks(*machine)) note(text, quiet);
  if (p.thin > 0)
    note("in " + std::to_string(p.thin) +
             " steps the cut is less deep than the lines are apart, and its angles are rough "
             "(--tolerance)",
         quiet);
  print_prediction(arguments, p, program.name());
  return 0;
}

}  // namespace

Program program_predict_program() {
  std::vector<Option> options = {
      {"--machine", "FILE", "its tools: [tool] or [tool.N]; how fast the axes go", true,
       FileUse::input},
      {"--stock-tolerance", "M",
       "by which surfaces of the stock may be off [m]: low_Nm and high_Nm hold it (0)"},
      {"--out", "CSV", "table of the steps", false, FileUse::output}};
  for (Option& option : stock_options()) options.push_back(std::move(option));
  for (Option& option : program_options()) options.push_back(std::move(option));
  return {{"program predict", "what an NC program removes, and what torque that asks for",
           std::move(options), "FILE",
           "The stock stands in the coordinates of the program. A row of the table is a step of a "
           "move: what is\n"
           "removed, how deep and wide, the angles at which teeth enter and leave, the area of "
           "contact; torque,\n"
           "force, power and deflection where [tool] has what they need."},
          run_program_predict};
}

}  // namespace servosense::cli
