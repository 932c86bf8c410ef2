// servosense identify torque-band: the reference of a program from recorded runs of it.
#include <cstdio>
#include <iostream>
#include <memory>
#include <utility>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/identify/torque_band_reference.hpp"
#include "servosense/io/json.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/monitors/torque_band_file.hpp"
#include "stack_signals.hpp"

namespace servosense::cli {
namespace {

/// The cutting torque of a trace, as the monitor will hear it.
Expected<TorqueRun> read_run(const MachineFile& machine, const std::string& path, double spacing_s,
                             Progress& progress, bool say) {
  auto reader = TraceReader::open(path);
  if (!reader) return reader.error();
  auto source = open_trace(std::move(*reader), path, machine);
  if (!source) return source.error();
  StackSignals signals = signals_of(*source);
  if (!signals.spindle)
    return data_error(path + ": needs the spindle's angle or speed and its current or torque");
  if (say) say_columns(*source, false);
  signals.axis = {};
  auto plan = plan_stack(machine, signals);
  if (!plan) return plan.error();
  auto stack = std::make_unique<HostStack>();
  stack->configure(plan->config);
  std::vector<double> torque, increment;
  ServoSample<double> sample;
  for (std::size_t n = 1;; ++n) {
    auto more = source->next(sample);
    if (!more) return more.error();
    if (!*more) break;
    stack->process(sample);
    const HostStack::Drive& spindle = stack->spindle();
    if (has(spindle.quality, Quality::gap))
      return data_error(path + ": samples of the spindle are missing at " +
                        std::to_string(seconds_from(sample.t_ns)) +
                        " s for longer than can be bridged; record the program again");
    torque.push_back(spindle.estimate);
    increment.push_back(spindle.sample.increment);
    if (n % 4096 == 0) progress.show(source->reader().progress());
  }
  const std::vector<double> advance(torque.size(), source->sample_period_s());
  auto run = average_revolutions(torque, increment, advance, spacing_s);
  if (!run) return Error{run.error().kind, path + ": " + run.error().sentence};
  return run;
}

int run_identify_torque_band(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  // What it shall be is not needed to find it.
  machine->remove_section("monitor.torque-band");
  if (arguments.operands().empty())
    return fail(usage_error("give one trace or more, each of a whole sound run of the program"));
  TorqueBandOptions options;
  options.above_share = options.below_share = 0.15;
  options.lead = options.lag = 0.3;
  options.max_shift = 1;
  double spacing_s = 0.05;
  for (const auto& [name, to] :
       {std::pair{"--above-share", &options.above_share},
        std::pair{"--below-share", &options.below_share},
        std::pair{"--above-Nm", &options.above_Nm}, std::pair{"--below-Nm", &options.below_Nm},
        std::pair{"--lead-s", &options.lead}, std::pair{"--lag-s", &options.lag},
        std::pair{"--max-shift-s", &options.max_shift}, std::pair{"--spacing-s", &spacing_s}}) {
    auto value = arguments.positive(name);
    if (!value) return fail(value.error());
    if (*value) *to = **value;
  }
  Progress progress("reading", arguments.quiet());
  std::vector<TorqueRun> runs;
  for (const std::string& path : arguments.operands()) {
    auto run = read_run(*machine, path, spacing_s, progress, runs.empty() && !arguments.quiet());
    if (!run) return fail(run.error());
    runs.push_back(std::move(*run));
  }
  auto band = make_torque_band(runs, options);
  if (!band) return fail(band.error());
  const std::string& out = arguments.at("--out");
  const std::string count = std::to_string(runs.size());
  if (auto done = write_torque_band(
          out, {band->spacing, band->points},
          "torque band taught by " + count + " run(s), servosense identify torque-band");
      !done)
    return fail(done.error());
  const double program_s = band->spacing * static_cast<double>(band->points.size() - 1);
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("out", out);
    json.member("program_s", program_s);
    json.member("spacing_s", band->spacing);
    json.values("shifts_s", band->shift);
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  std::printf("%.4g s of program, a point every %.4g s, from %zu run(s)\n", program_s,
              band->spacing, runs.size());
  for (std::size_t i = 1; i < band->shift.size(); ++i)
    std::printf("  %s came %.3g s later than the first\n", arguments.operands()[i].c_str(),
                band->shift[i]);
  std::printf("written to %s; name it as reference in [monitor.torque-band]\n", out.c_str());
  return 0;
}

}  // namespace

Program identify_torque_band_program() {
  return {{"identify torque-band",
           "expected torque of a program, with its tolerances, from sound runs of it",
           {{"--machine", "FILE", "machine file", true},
            {"--out", "FILE", "reference to write (CSV)", true},
            {"--above-share", "R", "tolerance above, part of the expected torque (0.15)", false},
            {"--below-share", "R", "the same below (0.15)", false},
            {"--above-Nm", "X", "tolerance above, besides the share (0)", false},
            {"--below-Nm", "X", "the same below (0)", false},
            {"--lead-s", "T", "time by which the torque may come early (0.3)", false},
            {"--lag-s", "T", "time by which it may come late (0.3)", false},
            {"--max-shift-s", "T", "most that a run may lie off the first (1)", false},
            {"--spacing-s", "T", "distance of the points (0.05)", false}},
           "TRACE...",
           "Each trace is one whole run, recorded from the start of the program on. Where air is "
           "cut the\n"
           "share of the torque is nothing: give --above-Nm and --below-Nm as well."},
          run_identify_torque_band};
}

}  // namespace servosense::cli
