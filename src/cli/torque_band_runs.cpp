#include "torque_band_runs.hpp"

#include <array>
#include <memory>
#include <utility>

#include "servosense/hal/sample_source.hpp"
#include "servosense/monitors/program_progress.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/observer/machine_config.hpp"
#include "signed_samples.hpp"
#include "stack_signals.hpp"

namespace servosense::cli {
namespace {

struct Replay {
  SampleSource source;
  StackPlan plan;
  std::unique_ptr<HostStack> stack;
};

Expected<Replay> open_run(const MachineFile& machine, const std::string& path) {
  auto reader = TraceReader::open(path);
  if (!reader) return reader.error();
  auto source = open_trace(std::move(*reader), path, machine);
  if (!source) return source.error();
  const StackSignals signals = signals_of(*source);
  if (!signals.drive(tool_spindle(machine)))
    return data_error(path + ": needs the " + std::string(name_of(tool_spindle(machine))) +
                      "'s angle or speed and its current or torque");
  auto plan = plan_stack(machine, signals);
  if (!plan) return plan.error();
  return Replay{std::move(*source), std::move(*plan), std::make_unique<HostStack>()};
}

}  // namespace

Expected<TorqueRun> read_torque_run(const MachineFile& machine, const std::string& path,
                                    TorqueRunOptions options, Progress& progress, bool say) {
  auto run = open_run(machine, path);
  if (!run) return run.error();
  run->source.program_used();
  if (say) say_columns(run->source, false);
  HostStack& stack = *run->stack;
  stack.configure(run->plan.config);
  options.sample_period_s = run->source.sample_period_s();
  if (options.over_path) {
    bool any = false;
    for (std::size_t i = 0; i < kAxes; ++i) any = any || run->plan.config.axis[i].present;
    if (!any)
      return data_error(path + ": needs the position and the effort of a feed axis that " +
                        machine.name() + " describes, for a band over path");
  }
  TorqueRunRecorder recorder(options);
  ProgramProgress<double, kAxes> moved;
  moved.configure(options.sample_period_s, options.over_path,
                  options.step / HostStack::Tool::kGrains);
  SignedSamples samples(run->source, machine, run->plan);
  MachineServoSample sample;
  for (std::size_t n = 1;; ++n) {
    auto more = samples.next(sample);
    if (!more) return more.error();
    if (!*more) break;
    stack.process(sample.of_spindle(run->plan.tool_spindle));
    const HostStack::Drive& spindle = stack.spindle();
    std::array<double, kAxes> way{};
    for (std::size_t i = 0; options.over_path && i < kAxes; ++i)
      if (run->plan.config.axis[i].present) way[i] = stack.axis(i).sample.increment;
    const double advance = moved.next(sample.t_ns, way, sample.feed_override);
    recorder.add(spindle.estimate, spindle.sample.increment, advance, sample.feed_override,
                 spindle.quality, sample.nc_block, spindle.sample.effort - spindle.estimate);
    if (n % 4096 == 0) progress.show(run->source.reader().progress());
  }
  auto steps = recorder.finish();
  if (!steps) return Error{steps.error().kind, path + ": " + steps.error().sentence};
  return steps;
}

Expected<HeldRun> hold_torque_run(const MachineFile& machine, const std::string& path,
                                  Progress& progress) {
  auto run = open_run(machine, path);
  if (!run) return run.error();
  prepare(*run->stack, run->plan);
  const auto& band = run->stack->tool().torque_band();
  const double alarm = run->plan.config.tool.torque_band.alarm_steps;
  HeldRun held;
  SignedSamples samples(run->source, machine, run->plan);
  MachineServoSample sample;
  for (std::size_t n = 1;; ++n) {
    auto more = samples.next(sample);
    if (!more) return more.error();
    if (!*more) break;
    run->stack->process(sample);
    const double value = alarm > 0 ? band.core().value / alarm : 0;
    if (value > held.worst) held = {value, seconds_from(sample.t_ns)};
    if (n % 4096 == 0) progress.show(run->source.reader().progress());
  }
  return held;
}

}  // namespace servosense::cli
