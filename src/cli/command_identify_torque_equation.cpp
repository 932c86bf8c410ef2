// servosense identify torque-equation: k1, k2, k3 of a tool and material from cuts, or from runs of
// a program that was predicted.
#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/identify/torque_equation_fit.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/table_file.hpp"
#include "servosense/io/text.hpp"
#include "torque_band_runs.hpp"

namespace servosense::cli {
namespace {

/// A block tells something from this many seconds of it on (chosen: ten steps of the recorder).
constexpr double kLeastBlock_s = 0.5;

/// Rows of a table by the names of its columns; a missing value is NaN.
Expected<std::vector<std::vector<double>>> columns_named(const std::string& path,
                                                         const std::vector<std::string>& names) {
  auto table = TableFile::open(path);
  if (!table) return table.error();
  const auto& headings = table->layout().headings;
  std::vector<std::size_t> at;
  for (const std::string& name : names) {
    const auto found = std::find(headings.begin(), headings.end(), name);
    if (found == headings.end())
      return data_error(path + ": has no column " + name + "; it needs " + name +
                        " among its headings");
    at.push_back(static_cast<std::size_t>(found - headings.begin()));
  }
  std::vector<std::vector<double>> rows;
  TableRow row;
  for (;;) {
    const auto more = table->next(row);
    if (!more) return more.error();
    if (!*more) return rows;
    std::vector<double> values;
    for (const std::size_t i : at) {
      const TableNumber n = table_number(row.fields[i], table->layout().mark);
      values.push_back(n.state == TableNumber::State::value ? n.value : std::nan(""));
    }
    rows.push_back(std::move(values));
  }
}

/// Means over the time of a block, of what the equation is linear in.
struct Block {
  double seconds = 0, removed_m2 = 0, contact_m2 = 0, feed_per_tooth_m = 0;
};

Expected<std::map<std::int32_t, Block>> predicted_blocks(const std::string& path) {
  const auto rows = columns_named(
      path, {"line", "t_s", "removed_m2", "contact_m2", "bottom_m2", "feed_per_tooth_m"});
  if (!rows) return rows.error();
  std::map<std::int32_t, Block> blocks;
  double before_s = 0;
  for (const auto& r : *rows) {
    const double dt = r[1] - before_s;
    before_s = r[1];
    Block& b = blocks[static_cast<std::int32_t>(r[0])];
    b.seconds += dt;
    b.removed_m2 += dt * r[2], b.contact_m2 += dt * (r[2] > 0 ? r[3] + r[4] : 0);
    b.feed_per_tooth_m += dt * r[5];
  }
  for (auto& [line, b] : blocks)
    if (b.seconds > 0)
      b.removed_m2 /= b.seconds, b.contact_m2 /= b.seconds, b.feed_per_tooth_m /= b.seconds;
  return blocks;
}

/// The blocks of a run, each a cut, without the level of those in the air.
Expected<std::vector<TorqueCut>> cuts_of_run(const MachineFile& machine, const std::string& path,
                                             const std::map<std::int32_t, Block>& blocks,
                                             Progress& progress, bool say) {
  const auto run = read_torque_run(machine, path, {}, progress, say);
  if (!run) return run.error();
  struct Mean {
    double sum = 0, points = 0;
  };
  std::map<std::int32_t, Mean> means;
  std::size_t k = 0;
  for (std::size_t i = 0; i < run->torque_Nm.size(); ++i) {
    while (k + 1 < run->sections.size() && run->sections[k + 1].first <= i) ++k;
    if (run->sections.empty() || !std::isfinite(run->torque_Nm[i])) continue;
    Mean& mean = means[run->sections[k].block];
    mean.sum += run->torque_Nm[i], mean.points += 1;
  }
  if (means.empty() || (means.size() == 1 && means.begin()->first == kNoBlock))
    return data_error(path + ": has no machine.nc_block, which tells the line of the program");
  Mean air;
  std::vector<TorqueCut> cuts;
  for (const auto& [line, mean] : means) {
    const auto block = blocks.find(line);
    if (block == blocks.end() || mean.points * run->spacing < kLeastBlock_s) continue;
    const Block& b = block->second;
    if (b.removed_m2 > 0)
      cuts.push_back({b.removed_m2, b.contact_m2, b.feed_per_tooth_m, mean.sum / mean.points});
    else
      air.sum += mean.sum, air.points += mean.points;
  }
  if (air.points > 0)
    for (TorqueCut& cut : cuts) cut.torque_Nm -= air.sum / air.points;
  return cuts;
}

int run_identify_torque_equation(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  if (arguments.operands().empty())
    return fail(usage_error("give tables of cuts, or --prediction and traces of the program"));
  std::string section = "tool";
  if (const auto number = arguments.value("--tool")) section += "." + *number;
  if (!machine->has_section(section))
    return fail(data_error(machine->name() + ": there is no [" + section + "]; add it"));
  std::vector<TorqueCut> cuts;
  Progress progress("reading", arguments.quiet());
  if (const auto table = arguments.value("--prediction")) {
    const auto blocks = predicted_blocks(*table);
    if (!blocks) return fail(blocks.error());
    bool say_it = !arguments.quiet();
    for (const std::string& path : arguments.operands()) {
      const auto found = cuts_of_run(*machine, path, *blocks, progress, say_it);
      if (!found) return fail(found.error());
      cuts.insert(cuts.end(), found->begin(), found->end());
      say_it = false;
    }
  } else {
    for (const std::string& path : arguments.operands()) {
      const auto rows = columns_named(
          path, {"removed_m2", "contact_m2", "feed_per_tooth_m", "spindle.torque_Nm"});
      if (!rows) return fail(rows.error());
      for (const auto& r : *rows)
        if (r[0] > 0) cuts.push_back({r[0], r[1], r[2], r[3]});
    }
  }
  const auto fit = fit_torque_equation(cuts);
  if (!fit)
    return fail(
        Error{fit.error().kind, arguments.operands().front() + ": " + fit.error().sentence});
  // As the study and machine files have them.
  const std::array<double, 3> unit = {1e-9, 1e-9, 1e-6};
  std::array<double, 3> k{}, error{};
  for (std::size_t i = 0; i < 3; ++i)
    k[i] = fit->k[i] * unit[i], error[i] = fit->standard_error[i] * unit[i];
  if (const auto out = arguments.value("--out")) {
    machine->set(section, "torque_equation",
                 std::vector<std::array<double, 3>>{{k[0], k[1], k[2]}});
    machine->set(section, "torque_equation_relative_error", fit->relative_error);
    if (const auto done = machine->write(*out); !done) return fail(done.error());
  }
  const std::array<const char*, 3> names = {"k1", "k2", "k3"};
  for (std::size_t i = 0; i < 3; ++i)
    if (fit->held_at_zero[i])
      note(std::string(names[i]) + " came out negative and is held at 0: these cuts do not show it",
           arguments.quiet());
  if (!arguments.json()) {
    const std::array<const char*, 3> units = {"Nm/mm3", "Nm/mm3", "Nm/mm2"};
    for (std::size_t i = 0; i < 3; ++i)
      say("%s = %.4g +- %.2g %s\n", names[i], k[i], error[i], units[i]);
    say("from %zu cuts; off by %.3g Nm, and by %.3g %% in cuts that did not teach it\n", fit->cuts,
        fit->residual_Nm, 100 * fit->relative_error);
    return 0;
  }
  JsonWriter json(std::cout, 2);
  json.begin_object();
  for (std::size_t i = 0; i < 3; ++i) {
    const std::string name = std::string(names[i]) + (i < 2 ? "_Nm_per_mm3" : "_Nm_per_mm2");
    json.member(name, k[i]);
    json.member(name + "_standard_error", error[i]);
  }
  json.values("torque_equation", k);
  json.member("residual_Nm", fit->residual_Nm);
  json.member("relative_error", fit->relative_error);
  json.member("cuts", fit->cuts);
  json.end_object();
  std::cout << '\n';
  return 0;
}

}  // namespace

Program identify_torque_equation_program() {
  return {
      {"identify torque-equation",
       "k1, k2, k3 of the torque equation, from cuts or runs of a program",
       {{"--machine", "FILE", "machine file, with the spindle and [tool]", true, FileUse::input},
        {"--out", "FILE", "machine file to write, with torque_equation", false, FileUse::renewed},
        {"--tool", "N", "tool number: [tool.N] (without: [tool])"},
        {"--prediction", "CSV",
         "table of 'program predict' of the program that the traces are runs of", false,
         FileUse::input}},
       "TABLE|TRACE...",
       "A table has a cut a row: removed_m2, contact_m2, feed_per_tooth_m, spindle.torque_Nm. "
       "With --prediction the\n"
       "operands are traces with machine.nc_block, the line of the program; each line that "
       "cuts is a cut, and what\n"
       "turns in the air is taken off. Two feeds and two radial depths are needed."},
      run_identify_torque_equation};
}

}  // namespace servosense::cli
