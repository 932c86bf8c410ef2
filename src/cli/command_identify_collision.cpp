// servosense identify collision: what the axes do in a sound cut, so that only more than that is a
// collision there.
#include <array>
#include <cstdio>
#include <iostream>
#include <optional>
#include <utility>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/identify/learn_thresholds.hpp"
#include "servosense/io/json.hpp"
#include "servosense/monitors/collision_keys.hpp"
#include "servosense/monitors/learned_under.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/observer/machine_config.hpp"
#include "signed_samples.hpp"
#include "stack_signals.hpp"

namespace servosense::cli {
namespace {

const char* rate_unit(std::size_t axis) { return is_turning(axis_channel(axis)) ? "Nm/s" : "N/s"; }

/// What the learner needs to know of the parts, from the first of them.
Expected<StackPlan> plan_for(const MachineFile& machine, const SampleSource& source,
                             const std::string& path) {
  const StackSignals signals = signals_of(source);
  if (!signals.drive(tool_spindle(machine)))
    return data_error(path + ": needs the " + std::string(name_of(tool_spindle(machine))) +
                      "'s angle or speed and its current or torque, " +
                      "which tell when the tool cuts");
  auto plan = plan_stack(machine, signals);
  if (!plan) return plan.error();
  bool any = false;
  for (std::size_t i = 0; i < kAllAxes; ++i) {
    if (!plan->config.axis[i].present) continue;
    any = true;
    const std::string other =
        learned_elsewhere(machine, plan->config, MonitorId::collision, axis_channel(i));
    if (!other.empty())
      return data_error(path + ": the threshold of " + std::string(name_of(axis_channel(i))) + " " +
                        other);
  }
  if (!any) return data_error(path + ": needs an axis with its motion and effort");
  if (!(plan->config.cut.torque_Nm > 0))
    return data_error(machine.name() +
                      ": [monitor.collision] lacks cutting_torque_Nm; run "
                      "'servosense identify idle' on an idling run first");
  return plan;
}

Expected<Done> listen(CutLearner& learner, SampleSource& source, SignedSamples samples,
                      Channel spindle, const std::string& path, Progress& progress) {
  const double before_s = learner.cutting_s();
  learner.start();
  MachineServoSample sample;
  for (std::size_t n = 1;; ++n) {
    auto more = samples.next(sample);
    if (!more) return more.error();
    if (!*more) break;
    learner.add(sample.of_spindle(spindle));
    if (n % 4096 == 0) progress.show(source.reader().progress());
  }
  if (learner.cutting_s() > before_s) return Done{};
  return data_error(path +
                    ": the spindle shows no cut, its torque stays below cutting_torque_Nm; "
                    "record a part that is cut");
}

int run_identify_collision(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  if (arguments.operands().empty())
    return fail(usage_error("give one trace or more, each of a sound part"));
  Progress progress("reading", arguments.quiet());
  std::optional<CutLearner> learner;
  StackPlan plan;
  std::array<bool, kAllAxes> heard{};
  double period_s = 0;
  for (const std::string& path : arguments.operands()) {
    auto reader = TraceReader::open(path);
    if (!reader) return fail(reader.error());
    auto source = open_trace(std::move(*reader), path, *machine);
    if (!source) return fail(source.error());
    std::array<bool, kAllAxes> axes{};
    for (std::size_t i = 0; i < kAllAxes; ++i) axes[i] = source->axis(i).has_value();
    if (!learner) {
      auto planned = plan_for(*machine, *source, path);
      if (!planned) return fail(planned.error());
      plan = std::move(*planned);
      learner.emplace(plan.config);
      heard = axes;
      say_columns(*source, arguments.quiet());
      period_s = source->sample_period_s();
    } else if (axes != heard || source->sample_period_s() != period_s) {
      return fail(data_error(path + ": has other axes or another sample rate than " +
                             arguments.operands().front() + "; give parts recorded alike"));
    }
    if (auto done = listen(*learner, *source, SignedSamples(*source, *machine, plan),
                           plan.tool_spindle, path, progress);
        !done)
      return fail(done.error());
  }
  for (std::size_t i = 0; i < kAllAxes; ++i) {
    if (!heard[i] || !(learner->highest(i) > 0)) continue;
    char comment[64];
    std::snprintf(comment, sizeof comment, "sound parts: %.3g", learner->highest(i));
    char value[40];
    std::snprintf(value, sizeof value, "%.8g", learner->threshold(i));
    const CollisionKeys keys(axis_channel(i));
    machine->set(keys.section, keys.cutting_threshold, std::string_view(value), comment);
    machine->set(keys.section, "provenance", "servosense identify idle, identify collision");
    write_learned_under(*machine, plan.config, axis_channel(i));
  }
  const std::string& out = arguments.at("--out");
  if (auto done = machine->write(out); !done) return fail(done.error());
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("out", out);
    json.member("cutting_s", learner->cutting_s());
    json.key("axes");
    json.begin_array();
    for (std::size_t i = 0; i < kAllAxes; ++i) {
      if (!heard[i]) continue;
      json.begin_object();
      json.member("channel", std::string_view(name_of(axis_channel(i))));
      const bool turns = is_turning(axis_channel(i));
      json.member(turns ? "highest_Nm_per_s" : "highest_N_per_s", learner->highest(i));
      json.member(turns ? "cutting_threshold_Nm_per_s" : "cutting_threshold_N_per_s",
                  learner->threshold(i));
      json.end_object();
    }
    json.end_array();
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  say("%.4g s of cutting in %zu part(s)\n", learner->cutting_s(), arguments.operands().size());
  for (std::size_t i = 0; i < kAllAxes; ++i)
    if (heard[i])
      say("  %s  highest %.4g %s, threshold in the cut %.4g %s\n",
          std::string(name_of(axis_channel(i))).c_str(), learner->highest(i), rate_unit(i),
          learner->threshold(i), rate_unit(i));
  say("written to %s\n", out.c_str());
  return 0;
}

}  // namespace

Program identify_collision_program() {
  return {{"identify collision",
           "thresholds of the collision monitor in the cut, from sound parts",
           {{"--machine", "FILE", "machine file that 'identify idle' has completed", true,
             FileUse::input},
            {"--out", "FILE", "machine file to write, with what was found", true, FileUse::output}},
           "TRACE...",
           "Each trace is a sound part, cut as all that follow will be. Until then the collision "
           "monitor is\n"
           "unarmed in the cut, where tooth passing alone exceeds what an idling run teaches."},
          run_identify_collision};
}

}  // namespace servosense::cli
