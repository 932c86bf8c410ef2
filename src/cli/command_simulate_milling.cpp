// servosense simulate milling: the cut of a machine file in the time domain, as a trace.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <utility>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/sim/milling_simulator.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::cli {
namespace {

int run_simulate_milling(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  auto wanted = arguments.positive("--duration");
  if (!wanted) return fail(wanted.error());
  const double duration_s =
      wanted->value_or(machine->number("simulation", "duration_s").value_or(1));
  auto simulation = milling_simulation(*machine, duration_s);
  if (!simulation) return fail(simulation.error());
  auto simulator = MillingSimulator::create(*simulation);
  if (!simulator) return fail(simulator.error());
  using enum Quantity;
  auto writer = TraceWriter::create(arguments.at("--out"),
                                    {{Channel::spindle, angle_rad},
                                     {Channel::spindle, speed_rad_s},
                                     {Channel::spindle, torque_Nm},
                                     {Channel::tool, force_x_N},
                                     {Channel::tool, force_y_N},
                                     {Channel::tool, displacement_x_m},
                                     {Channel::tool, displacement_y_m},
                                     {Channel::tool, feed_per_tooth_m}},
                                    {{"source", "servosense simulate milling"}});
  if (!writer) return fail(writer.error());
  Progress progress("simulating", arguments.quiet());
  const double rate_hz = servo_rate_hz(*machine);
  std::size_t rows = 0;
  Expected<Done> written = Done{};
  auto done =
      simulator->run(duration_s, rate_hz, Decimation::average, [&](const MillingStep& step) {
        if (!written) return;
        const double values[] = {step.angle_rad, step.spindle_speed_rad_s,
                                 step.torque_Nm, step.fx_N,
                                 step.fy_N,      step.x_m,
                                 step.y_m,       simulation->cut.feed_per_tooth_m};
        // The sample's own instant: its last step may end a little earlier.
        ++rows;
        written = writer->write(std::llround(static_cast<double>(rows) / rate_hz * 1e9), values);
        if (rows % 1024 == 0) progress.show(step.t_s / duration_s);
      });
  if (!written) return fail(written.error());
  if (!done) return fail(done.error());
  if (done = writer->close(); !done) return fail(done.error());
  std::printf("%zu rows: %s\n", rows, arguments.at("--out").c_str());
  return 0;
}

}  // namespace

Program simulate_milling_program() {
  return {
      {"simulate milling",
       "a milling cut in the time domain, as a trace",
       {{"--machine", "FILE", "machine file with [tool], [cut], [structure.*], [simulation]", true},
        {"--out", "TRACE", "trace to write", true},
        {"--duration", "S", "seconds to simulate (duration_s of [simulation], else 1)", false}},
       "",
       ""},
      run_simulate_milling};
}

}  // namespace servosense::cli
