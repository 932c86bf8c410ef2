// servosense simulate milling: the cut of a machine file in the time domain, as a trace.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/sim/machine_simulator.hpp"
#include "servosense/sim/milling_simulator.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::cli {
namespace {

/// What both kinds of simulation print.
struct Outcome {
  std::size_t rows = 0;
  double cut_from_s = 0, cut_to_s = 0;
  double torque_sum_Nm = 0, largest_force_N = 0, largest_displacement_m = 0;
  std::size_t cutting_rows = 0;
  Expected<Roughness> roughness = usage_error("not known");

  void add(const MillingStep& cut) {
    torque_sum_Nm += cut.torque_Nm;
    largest_force_N = std::max(largest_force_N, std::hypot(cut.fx_N, cut.fy_N));
    largest_displacement_m = std::max(largest_displacement_m, std::hypot(cut.x_m, cut.y_m));
    ++cutting_rows;
  }
};

Expected<Roughness> roughness_of(const MillingSimulator& cut, const MillingSimulation& s) {
  const WallProfile& wall = cut.surface().wall(0, s.cut.direction);
  // What was cut from beginning to end: a radius from either end the wall is not finished.
  const double radius = s.tool.radius_m();
  const double last = wall.first_x_m + wall.spacing_m * static_cast<double>(wall.height_m.size());
  return roughness(wall.between(wall.first_x_m + radius, last - radius));
}

/// The cut alone, at the servo rate.
Expected<Outcome> simulate_cut(const MachineFile& machine, double duration_s,
                               const std::string& out, Progress& progress) {
  auto simulation = milling_simulation(machine, duration_s);
  if (!simulation) return simulation.error();
  auto simulator = MillingSimulator::create(*simulation);
  if (!simulator) return simulator.error();
  const double rate_hz = servo_rate_hz(machine);
  if (rate_hz * simulation->step_s > 1 + 1e-9)
    return data_error(machine.where("machine", "sample_rate_hz") + ": sample_rate_hz of " +
                      number_text(rate_hz) + " Hz asks for more than one sample in a step of " +
                      number_text(simulation->step_s) + " s; lower it, or step_s in [simulation]");
  using enum Quantity;
  std::vector<Signal> signals = {
      {Channel::spindle, angle_rad},     {Channel::spindle, speed_rad_s},
      {Channel::spindle, torque_Nm},     {Channel::tool, force_x_N},
      {Channel::tool, force_y_N},        {Channel::tool, displacement_x_m},
      {Channel::tool, displacement_y_m}, {Channel::tool, feed_per_tooth_m}};
  const bool axial = simulation->tool.force.has_axial();
  if (axial) signals.push_back({Channel::tool, force_z_N});
  auto writer = TraceWriter::create(out, signals, {{"source", "servosense simulate milling"}});
  if (!writer) return writer.error();
  Outcome outcome;
  outcome.cut_to_s = duration_s;
  Expected<Done> written = Done{};
  auto done =
      simulator->run(duration_s, rate_hz, Decimation::average, [&](const MillingStep& step) {
        if (!written) return;
        const double values[] = {step.angle_rad, step.spindle_speed_rad_s,
                                 step.torque_Nm, step.fx_N,
                                 step.fy_N,      step.x_m,
                                 step.y_m,       simulation->cut.feed_per_tooth_m,
                                 step.fz_N};
        // The sample's own instant: its last step may end a little earlier.
        ++outcome.rows;
        outcome.add(step);
        written = writer->write(std::llround(static_cast<double>(outcome.rows) / rate_hz * 1e9),
                                std::span(values).first(signals.size()));
        if (outcome.rows % 1024 == 0) progress.show(step.t_s / duration_s);
      });
  if (!written) return written.error();
  if (!done) return done.error();
  if (done = writer->close(); !done) return done.error();
  outcome.roughness = roughness_of(*simulator, *simulation);
  return outcome;
}

/// The cut between its drives.
Expected<Outcome> simulate_machine(const MachineFile& machine, double cut_s, bool truth,
                                   const std::string& out, Progress& progress,
                                   std::string& remark) {
  auto simulation = machine_simulation(machine, cut_s);
  if (!simulation) return simulation.error();
  auto simulator = MachineSimulator::create(*simulation);
  if (!simulator) return simulator.error();
  auto writer = TraceWriter::create(out, record_signals(simulator->simulation(), truth),
                                    record_metadata(*simulator));
  if (!writer) return writer.error();
  if (simulation->z && !simulation->milling.tool.force.has_axial())
    remark =
        "the z drive is loaded by gravity alone: [tool] has neither axial_coefficient_N_per_m2 nor "
        "axial_edge_N_per_m; 'servosense identify cutting' finds them with a dynamometer";
  const CutSchedule& schedule = simulator->schedule();
  Outcome outcome;
  outcome.cut_from_s = schedule.contact_s;
  outcome.cut_to_s = schedule.stop_s;
  std::vector<TraceField> row;
  auto done = simulator->run([&](const MachineSample& sample) {
    record_row(simulator->simulation(), sample, truth, row);
    if (sample.t_s >= schedule.contact_s && sample.t_s < schedule.stop_s) outcome.add(sample.cut);
    if (++outcome.rows % 1024 == 0) progress.show(sample.t_s / schedule.end_s);
    return writer->write(std::llround(sample.t_s * 1e9), row);
  });
  if (!done) return done.error();
  if (done = writer->close(); !done) return done.error();
  outcome.roughness = roughness_of(simulator->milling(), simulation->milling);
  return outcome;
}

int run_simulate_milling(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  auto wanted = arguments.positive("--duration");
  if (!wanted) return fail(wanted.error());
  const double duration_s =
      wanted->value_or(machine->number("simulation", "duration_s").value_or(1));
  bool drives = false;
  for (const char* controller :
       {"controller.spindle", "controller.x", "controller.y", "controller.z"})
    drives = drives || machine->has_section(controller);
  drives = drives && !arguments.has("--ideal-drives");

  Expected<Outcome> outcome = usage_error("");
  std::string remark;
  {
    Progress progress("simulating", arguments.quiet());
    const std::string& out = arguments.at("--out");
    outcome = drives ? simulate_machine(*machine, duration_s, arguments.has("--truth"), out,
                                        progress, remark)
                     : simulate_cut(*machine, duration_s, out, progress);
  }
  if (!outcome) return fail(outcome.error());
  if (!remark.empty()) note(remark, arguments.quiet());
  const double mean_Nm = outcome->cutting_rows > 0
                             ? outcome->torque_sum_Nm / static_cast<double>(outcome->cutting_rows)
                             : 0;
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("out", arguments.at("--out"));
    json.member("rows", outcome->rows);
    json.member("drives", drives);
    json.member("cut_from_s", outcome->cut_from_s);
    json.member("cut_to_s", outcome->cut_to_s);
    json.member("mean_torque_Nm", mean_Nm);
    json.member("largest_force_N", outcome->largest_force_N);
    json.member("largest_displacement_m", outcome->largest_displacement_m);
    json.key("roughness_ra_m");
    json.value(outcome->roughness ? outcome->roughness->ra_m
                                  : std::numeric_limits<double>::quiet_NaN());
    json.key("roughness_rz_m");
    json.value(outcome->roughness ? outcome->roughness->rz_m
                                  : std::numeric_limits<double>::quiet_NaN());
    json.end_object();
    std::cout << '\n';
  } else if (!arguments.quiet()) {
    say("cut from %.4g to %.4g s: mean torque %.4g Nm, force up to %.4g N, "
        "displacement up to %.4g um\n",
        outcome->cut_from_s, outcome->cut_to_s, mean_Nm, outcome->largest_force_N,
        1e6 * outcome->largest_displacement_m);
    if (outcome->roughness)
      say("wall: Ra %.4g um, Rz %.4g um\n", 1e6 * outcome->roughness->ra_m,
          1e6 * outcome->roughness->rz_m);
    say("%zu rows: %s\n", outcome->rows, arguments.at("--out").c_str());
  }
  return 0;
}

}  // namespace

Program simulate_milling_program() {
  return {{"simulate milling",
           "a milling cut in the time domain, as a trace",
           {{"--machine", "FILE", "machine file with [tool], [cut], [structure.*], [simulation]",
             true, FileUse::input},
            {"--out", "TRACE", "trace to write", true, FileUse::output},
            {"--duration", "S", "seconds of cutting (duration_s of [simulation], else 1)", false},
            {"--ideal-drives", "", "leave out the drives of [controller.*]", false},
            {"--truth", "", "with drives: also what no controller knows, forces above all", false}},
           "",
           "With [controller.spindle] and the like the trace is what a controller records: run-up, "
           "feed in\n"
           "the air, the cut, run-down, as encoder counts and currents. Without, it is the cut "
           "alone, with\n"
           "its forces on the tool, its torque and the tool's displacements."},
          run_simulate_milling};
}

}  // namespace servosense::cli
