// servosense identify presliding: what friction does before it breaks away.
#include <cstdio>
#include <iostream>
#include <optional>
#include <utility>

#include "commands.hpp"
#include "console.hpp"
#include "drive_records.hpp"
#include "effort_unit.hpp"
#include "estimate_text.hpp"
#include "servosense/identify/presliding.hpp"
#include "servosense/io/json.hpp"
#include "servosense/monitors/learned_under.hpp"
#include "stack_signals.hpp"

namespace servosense::cli {
namespace {

constexpr const char* kPreslidingProvenance = "servosense identify presliding";

struct Pushed {
  Channel channel = Channel::spindle;
  std::string unit;  // of its effort
  PreslidingIdentification found;
};

/// Names of what is found, in the file and in JSON.
struct PreslidingKeys {
  const char *slope, *stiffness, *breakaway, *knee, *travel, *effort, *coulomb;
};
constexpr PreslidingKeys presliding_keys(Channel channel) {
  return is_turning(channel)
             ? PreslidingKeys{"slope_Nm_per_rad",   "stiffness_Nm_per_rad", "breakaway_Nm",
                              "friction_knee_rad",  "travel_rad",           "effort_Nm",
                              "coulomb_friction_Nm"}
             : PreslidingKeys{"slope_N_per_m",     "stiffness_N_per_m", "breakaway_N",
                              "friction_knee_m",   "travel_m",          "effort_N",
                              "coulomb_friction_N"};
}

/// The knee, and the bristle where there is a Coulomb friction that it takes the place of.
void write_pushed(MachineFile& machine, const Pushed& pushed, std::vector<std::string>& remarks) {
  const PreslidingIdentification& found = pushed.found;
  const PreslidingKeys keys = presliding_keys(pushed.channel);
  const std::string name(name_of(pushed.channel)), section(section_of(pushed.channel));
  if (found.friction_knee > 0)
    machine.set(section, keys.knee, rounded(found.friction_knee),
                "friction over the slope of its loop");
  if (!found.one_bristle) return;
  if (!found.resolved) {
    remarks.push_back(name +
                      ": a count of the encoder moves the bristle by more than a quarter of "
                      "its breakaway, so an observer could not follow it: the knee alone is "
                      "written");
    return;
  }
  if (!(machine.number(section, keys.coulomb).value_or(0) > 0)) {
    remarks.push_back(name + ": [" + section + "] has no " + keys.coulomb +
                      ", whose place the bristle would take, so none is written; run 'servosense "
                      "identify idle' on a record that moves first");
    return;
  }
  const std::string effect = "effect." + name + ".presliding-hysteresis";
  machine.remove_section(effect);
  machine.set(effect, keys.stiffness, rounded(found.stiffness.value), plus_minus(found.stiffness));
  machine.set(effect, keys.breakaway, rounded(found.breakaway.value),
              found.breakaway_fitted ? plus_minus(found.breakaway) : "the Coulomb friction");
  machine.set(effect, "provenance", kPreslidingProvenance);
  const MonitorId monitor = is_spindle(pushed.channel) ? MonitorId::chatter : MonitorId::collision;
  if (states_conditions(machine, monitor, pushed.channel))
    remarks.push_back(name +
                      ": the monitors hear the bristle, and what they learned before did "
                      "not: run 'servosense identify idle' again with the file written here");
}

void print_pushed(const Pushed& pushed) {
  const PreslidingIdentification& found = pushed.found;
  const bool turns = is_turning(pushed.channel);
  const std::string spring = derived_unit(pushed.unit, turns ? "/rad" : "/m");
  const char* length = turns ? "rad" : "m";
  say("%s, %zu pushes of up to %.4g %s and %.4g %s\n", std::string(name_of(pushed.channel)).c_str(),
      found.pushes, found.effort, pushed.unit.c_str(), found.travel, length);
  print_row("slope of the loop", found.slope, spring);
  if (found.one_bristle) {
    print_row("after a reversal", found.stiffness, spring);
    if (found.breakaway_fitted)
      print_row("breakaway", found.breakaway, pushed.unit);
    else
      say("  %-22s %12.6g %s (the Coulomb friction)\n", "breakaway", found.breakaway.value,
          pushed.unit.c_str());
  }
  if (found.friction_knee > 0)
    say("  %-22s %12.6g %s\n", "friction knee", found.friction_knee, length);
}

void print_pushed_json(const std::vector<Pushed>& all, const std::vector<std::string>& remarks,
                       const std::string& out) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("out", out);
  json.objects("drives", all, [&](const Pushed& pushed) {
    const PreslidingKeys keys = presliding_keys(pushed.channel);
    const PreslidingIdentification& found = pushed.found;
    json.member("channel", std::string_view(name_of(pushed.channel)));
    json.member("unit", pushed.unit);
    json.member("pushes", found.pushes);
    json.member(keys.effort, found.effort);
    json.member(keys.travel, found.travel);
    write_estimate(json, keys.slope, found.slope);
    json.member("one_bristle", found.one_bristle);
    json.member("resolved", found.resolved);
    if (found.one_bristle) {
      write_estimate(json, keys.stiffness, found.stiffness);
      write_estimate(json, keys.breakaway, found.breakaway);
    }
    json.member("residual_share", found.residual_share);
    if (found.friction_knee > 0) json.member(keys.knee, found.friction_knee);
  });
  json.values("remarks", remarks);
  json.end_object();
  std::cout << '\n';
}

int run_identify_presliding(const Arguments& arguments) {
  const std::string &trace_path = arguments.at("--trace"), &out = arguments.at("--out");
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  auto reader = TraceReader::open(trace_path);
  if (!reader) return fail(reader.error());
  auto source = open_trace(std::move(*reader), trace_path, *machine);
  if (!source) return fail(source.error());
  auto plan = plan_stack(*machine, signals_of(*source));
  if (!plan) return fail(plan.error());
  std::vector<std::string> remarks = plan->remarks;
  for (std::string& remark : source->column_remarks()) remarks.push_back(std::move(remark));
  Progress progress("reading", arguments.quiet());
  auto records = read_records(*source, *plan, progress);
  if (!records) return fail(records.error());

  std::vector<Pushed> all;
  std::optional<Error> first_error;
  for (const DriveRecord& record : *records) {
    const HostDriveSlotConfig& slot = *plan->slot_of(record.channel);
    const double grain =
        slot.input.kind == MotionKind::counts ? std::abs(slot.input.unit_per_count) : 0;
    const std::string section(section_of(record.channel));
    auto found =
        machine->flag(section, "current_is_unsigned").value_or(false)
            ? data_error(std::string(name_of(record.channel)) + ": [" + section +
                         "] current_is_unsigned says that the current has no sign, and motion "
                         "below breakaway does not give it one; record it with its sign")
            : identify_presliding(slot.observer, record, grain);
    if (!found) {
      if (!first_error) first_error = found.error();
      remarks.push_back(found.error().sentence);
      continue;
    }
    Pushed pushed{record.channel, effort_unit(*machine, record.channel), std::move(*found)};
    for (const std::string& remark : pushed.found.remarks) remarks.push_back(remark);
    write_pushed(*machine, pushed, remarks);
    all.push_back(std::move(pushed));
  }
  if (all.empty()) return fail(*first_error);
  if (auto done = machine->write(out); !done) return fail(done.error());
  if (!arguments.quiet())
    for (const std::string& remark : remarks) note(remark);
  if (arguments.json()) {
    print_pushed_json(all, remarks, out);
    return 0;
  }
  for (const Pushed& pushed : all) print_pushed(pushed);
  say("written to %s\n", out.c_str());
  return 0;
}

}  // namespace

Program identify_presliding_program() {
  return {{"identify presliding",
           "stiffness of friction before it breaks away",
           {{"--machine", "FILE", "machine file to start from", true, FileUse::input},
            {"--trace", "FILE", "trace of a drive that is pushed and does not slide", true,
             FileUse::input},
            {"--out", "FILE", "machine file to write, with what was found", true, FileUse::output}},
           "",
           "Push the drive slowly up and down, to some 80 % of what makes it break away, a cycle "
           "in some seconds,\n"
           "with the position loop open (torque mode) or a small slow reference."},
          run_identify_presliding};
}

}  // namespace servosense::cli
