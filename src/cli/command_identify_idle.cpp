// servosense identify idle: parameters, floors and thresholds from an idling run.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <memory>
#include <optional>
#include <utility>

#include "commands.hpp"
#include "console.hpp"
#include "drive_records.hpp"
#include "effort_pairs.hpp"
#include "effort_unit.hpp"
#include "estimate_text.hpp"
#include "idle_found.hpp"
#include "idle_pairs.hpp"
#include "sensor_watches.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/identify/cut_evidence.hpp"
#include "servosense/identify/effort_sign.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/identify/idle_signs.hpp"
#include "servosense/identify/idle_temperature.hpp"
#include "servosense/identify/learn_thresholds.hpp"
#include "servosense/identify/power_losses.hpp"
#include "servosense/identify/torque_path.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/monitors/collision_keys.hpp"
#include "servosense/monitors/learned_under.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/observer/machine_config.hpp"
#include "slow_chatter_watch.hpp"
#include "stack_signals.hpp"

namespace servosense::cli {
namespace {

std::vector<double> knees_to_try(Channel channel, double configured, double unit_per_count,
                                 bool fixed) {
  if (fixed) return {configured};
  const std::array<double, 6> axis = {1e-6, 2e-6, 5e-6, 1e-5, 2e-5, 5e-5};
  const std::array<double, 6> table = {2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3};
  const std::array<double, 4> spindle = {3e-4, 1e-3, 3e-3, 1e-2};
  std::vector<double> knees = {configured};
  auto add = [&](double knee) {
    if (knee >= 4 * unit_per_count) knees.push_back(knee);
  };
  if (is_spindle(channel))
    for (const double knee : spindle) add(knee);
  else if (is_turning(channel))
    for (const double knee : table) add(knee);
  else
    for (const double knee : axis) add(knee);
  return knees;
}

void take_out(DriveEffectsConfig& effects, std::string_view name) {
  for (std::size_t e = 0; e < effects.count; ++e)
    if (effects.settings[e].effect == drive_effect_index(name)) {
      effects.settings[e] = effects.settings[--effects.count];
      return;
    }
}

/// Of an effort that is an absolute value, by the machine file or by what the record shows: what is
/// said of it; empty where it has a sign.
Expected<std::string> find_signs(MachineFile& machine, DriveRecord& record,
                                 const HostDriveSlotConfig& slot, const IdleOptions& options) {
  const std::string section(section_of(record.channel));
  const auto stated = machine.flag(section, "current_is_unsigned");
  const bool current = slot.observer.drive.effort_per_ampere > 0;
  if (stated ? !*stated : !current && !options.power) return std::string();
  const double grain =
      slot.input.kind == MotionKind::counts ? std::abs(slot.input.unit_per_count) : 0;
  std::optional<double> share;
  if (stated) {
    auto found = find_idle_signs(slot.observer, record, grain, options);
    if (!found) return found.error();
    share = *found;
  } else {
    share = recognise_idle_signs(slot.observer, record, grain, options);
    if (!share) return std::string();
    machine.set(section, "current_is_unsigned", true, "never negative, and the motion asks for it");
  }
  return signs_found(record.channel, *share);
}

Error not_idle(const std::string& trace, const DriveRecord& record, const std::string& evidence) {
  return data_error(trace + ": " + std::string(name_of(record.channel)) +
                    " is not idle, something is cut: " + evidence +
                    "; record the same motion in the air");
}

/// What an earlier run found of motor and load is found anew.
void take_out_found_by_pairs(const MachineFile& machine, Channel channel,
                             DisturbanceObserverConfig& observer) {
  for (const char* name : {"backlash", "flexible-coupling"}) {
    const std::string section = "effect." + std::string(name_of(channel)) + "." + name;
    const std::string found_by = machine.text(section, "provenance").value_or("");
    if (found_by.starts_with(kIdleProvenance)) take_out(observer.drive.effects, name);
  }
}

/// Puts the effect into the model of the monitors where they read less with it in the last third
/// of the record.
bool take_if_it_helps(DisturbanceObserverConfig& watching, const EffectSetting& effect,
                      const DriveRecord& record) {
  DisturbanceObserverConfig with = watching;
  DriveEffectsConfig& effects = with.drive.effects;
  if (effects.count == kMaxActiveEffects) return false;
  effects.settings[effects.count++] = effect;
  if (!DisturbanceObserver<double>::validate(with).ok()) return false;
  const std::size_t from = 2 * record.samples.size() / 3;
  if (!(idle_reading(with, record, from) < idle_reading(watching, record, from))) return false;
  watching = with;
  return true;
}

/// Of one motor of two the share is not known exactly, nor then is what follows from it.
void widen_by_share(IdleIdentification& idle, double relative_error) {
  for (Estimate* e : {&idle.inertia, &idle.viscous, &idle.coulomb, &idle.constant_load})
    e->standard_error = std::hypot(e->standard_error, e->value * relative_error);
}

int run_identify_idle(const Arguments& arguments) {
  const std::string& trace_path = arguments.at("--trace");
  auto rate = arguments.within("--false-alarm-rate-per-hour", 1e-6, 60);
  if (!rate) return fail(rate.error());
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  auto reader = TraceReader::open(trace_path);
  if (!reader) return fail(reader.error());
  // What an earlier run found of the losses of a power is found anew.
  ColumnChoices choices = column_choices(*machine);
  for (ColumnChoice* spindle : {&choices.spindle, &choices.spindle2}) spindle->power = {};
  // What the constant does with temperature is found anew where there is one.
  const ColumnChoices stated = choices;
  auto rows = trace_rows(std::move(*reader));
  std::vector<std::size_t> temperatures;
  for (const Channel channel : kDriveChannels)
    if (const auto column =
            column_named(rows->signals(), column_name({channel, Quantity::temperature_C}))) {
      temperatures.push_back(*column);
      choices.drive(channel).constant.per_K = 0;
    }
  auto efforts = std::make_shared<EffortPairs>(*machine, rows->signals(), false);
  PairRecorder paired;
  auto source = SampleSource::open(paired.tap(EffortPairs::tap(std::move(rows), efforts), *machine),
                                   trace_path, SampleSource::kMaxFill, choices);
  if (!source) return fail(source.error());
  source->also_used(efforts->used());
  source->also_used(paired.columns());
  for (const Channel channel : kSensorChannels)
    if (const auto column = sensor_column(*machine, channel, source->reader().signals()))
      source->also_used({*column});
  source->also_used(temperatures);
  auto plan = plan_stack(*machine, signals_of(*source));
  if (!plan) return fail(plan.error());
  std::vector<std::string> remarks = plan->remarks;
  for (std::string& remark : source->column_remarks()) remarks.push_back(std::move(remark));

  Progress progress("reading", arguments.quiet());
  auto records = read_records(*source, *plan, progress);
  if (!records) return fail(records.error());

  for (std::string& said : efforts->learn(*machine)) remarks.push_back(std::move(said));
  const auto slot_of = [&](const DriveRecord& record) { return *plan->slot_of(record.channel); };
  const bool all_stand = std::all_of(
      records->begin(), records->end(),
      [&](const DriveRecord& record) { return drive_stands(slot_of(record).observer, record); });
  std::vector<IdleFound> all;
  std::optional<Error> first_error;
  Progress learning("learning", arguments.quiet());
  for (DriveRecord& record : *records) {
    learning.show(std::string(name_of(record.channel)),
                  static_cast<std::size_t>(&record - records->data()) + 1, records->size());
    const bool spindle = is_spindle(record.channel), turns = is_turning(record.channel);
    const bool has_tool = record.channel == plan->tool_spindle;
    const std::string name(name_of(record.channel)), section(section_of(record.channel));
    const HostStackConfig& stack = plan->stack_of(record.channel);
    HostDriveSlotConfig slot = slot_of(record);
    // What an earlier run found of these is found anew.
    take_out(slot.observer.drive.effects, "constant-load");
    const PairRecord* const pair_record = paired.of(record.channel);
    if (pair_record != nullptr) take_out_found_by_pairs(*machine, record.channel, slot.observer);
    const bool of_current = spindle && slot.observer.drive.effort_per_ampere > 0;
    IdleOptions options;
    for (const auto& [effect, seek] : {std::pair{kWeakening, &options.seek_field_weakening},
                                       std::pair{kSaturation, &options.seek_saturation}}) {
      if (machine->text(effect_section(record.channel, effect), "provenance") == kIdleProvenance)
        take_out(slot.observer.drive.effects, effect);
      *seek = of_current && slot.observer.drive.effects.find(effect) == nullptr;
    }
    if (*rate) options.false_alarm_rate_per_hour = **rate;
    const bool fixed = machine->has(section, idle_keys(record.channel).knee);
    options.knees = knees_to_try(record.channel, slot.observer.drive.friction_knee,
                                 slot.input.unit_per_count, fixed);
    options.power = source->drive(record.channel)->power.has_value();
    const double slowest_rad_s = slowest_of_power(record, PowerReading::kKnownFrom_rad_s);
    if (options.power)
      mark_too_slow(record.samples, record.sample_period_s, slowest_rad_s, Quality::gap);
    if (auto said = find_signs(*machine, record, slot, options); !said)
      remarks.push_back(said.error().sentence);
    else if (!said->empty())
      remarks.push_back(std::move(*said));
    std::optional<FoundLosses> losses;
    if (options.power)
      if (auto lost = find_power_losses(slot.observer, record, slowest_rad_s, options)) {
        losses = *lost;
        options.losses = {losses->constant_W.value, losses->copper_W_per_Nm2.value};
      }
    if (const auto cut = effort_jumps(record)) return fail(not_idle(trace_path, record, *cut));
    IdleRefusal why = IdleRefusal::none;
    IdleFound found;
    found.constant = stated.drive(record.channel).constant;
    const bool warms = !record.temperature_C.empty();
    if (warms) found.over_temperature.emplace();
    auto idle = warms ? identify_idle_over_temperature(slot.observer, record, found.constant,
                                                       *found.over_temperature, options, &why)
                      : identify_idle(slot.observer, record, options, &why);
    if (warms && !found.over_temperature->refusal.empty())
      remarks.push_back(found.over_temperature->refusal);
    found.channel = record.channel;
    found.unit = effort_unit(*machine, record.channel);
    found.power = losses;
    found.torque_constant_sought = of_current;
    found.ampere = of_current ? slot.observer.drive.effort_per_ampere : 0;
    found.saturation_sought = options.seek_saturation;
    DisturbanceObserverConfig watching = slot.monitor_observer;
    if (idle) {
      found.parameters = std::move(*idle);
      widen_by_share(*found.parameters, effort_share(*machine, record.channel).relative_error);
      remarks.insert(remarks.end(), found.parameters->remarks.begin(),
                     found.parameters->remarks.end());
      if (found.torque_constant_sought && !(found.parameters->constant_known_to > 0))
        remarks.push_back(
            name +
            ": the record shows torque per ampere within 5 % at no speed; it is taken "
            "as the machine file has it, at all of them");
      if (std::string said = saturation_remark(found); !said.empty())
        remarks.push_back(std::move(said));
      watching.drive = identified_drive(slot.observer.drive, *found.parameters);
      DisturbanceObserverConfig with_effects = slot.observer;
      with_effects.drive = watching.drive;
      found.path = identify_torque_path(with_effects, *found.parameters, record);
      const bool vertical = !turns && machine->flag(section, "vertical").value_or(false);
      if (!vertical && is_load(*found.parameters) &&
          !load_helps(watching, record, *found.parameters, options)) {
        found.load_helps = false;
        watching.drive.constant_load = 0;
        remarks.push_back(name +
                          ": the constant load is kept from the monitors (used_by_monitors = no): "
                          "it does not hold in the last third of the record");
      }
    } else {
      if (!first_error) first_error = idle.error();
      remarks.push_back(idle.error().sentence);
      const bool left = why == IdleRefusal::stands && !all_stand;
      if (left || why == IdleRefusal::effort) {
        remarks.back() +=
            left ? "; it stands while others move, and stays as the machine file has it" : "";
        continue;
      }
      remarks.push_back(name +
                        ": thresholds alone are learned, with inertia and friction as the machine "
                        "file has them, and hold for such motion only");
      if (why == IdleRefusal::motion) found.running = running_effort(record);
    }
    if (pair_record != nullptr) {
      const bool has_sign = !machine->flag(section, "current_is_unsigned").value_or(false);
      auto pairs = learn_pairs(*pair_record, has_sign, options.false_alarm_rate_per_hour);
      if (!pairs) return fail(data_error(trace_path + ": " + pairs.error().sentence));
      remarks.insert(remarks.end(), pairs->remarks.begin(), pairs->remarks.end());
      found.pairs = std::move(*pairs);
      if (const auto backlash = backlash_found(*machine, record.channel, *found.pairs))
        found.backlash_helps = take_if_it_helps(watching, *backlash, record);
    }
    if (spindle)
      if (const auto cut = torque_repeats(watching, stack.spindle.chatter, record))
        return fail(not_idle(trace_path, record, *cut));
    if (spindle) {
      found.chatter =
          learn_chatter(watching, stack.spindle.chatter, record, options.false_alarm_rate_per_hour);
      if (is_slow(record.sample_period_s)) {
        std::vector<VibrationSample> heard;
        for (const DriveSample<double>& s : record.samples)
          heard.push_back({s.effort, s.increment, s.quality});
        found.lines =
            learn_vibration(slow_vibration_config(*machine, record.channel, record.sample_period_s),
                            heard, options.false_alarm_rate_per_hour);
      }
      // What is left in the air tells of a cut where friction and inertia are taken off.
      if (found.parameters && has_tool)
        found.cutting_torque_Nm = learn_cutting_torque(watching, plan->config.cut, record);
    } else {
      found.collision = learn_collision(watching, stack.axis[axis_index(record.channel)].collision,
                                        record, options.false_alarm_rate_per_hour);
    }
    if (const auto teeth = machine->number("tool", "teeth"); has_tool && teeth && *teeth >= 2)
      found.tooth = learn_tooth_noise(watching, static_cast<unsigned>(*teeth), record);
    if (spindle && found.chatter.count() > 0 && !found.chatter.rate.known())
      remarks.push_back(name +
                        ": the run is too short to say how often the chatter threshold is "
                        "passed by chance; let it turn at a speed for some " +
                        std::to_string(AlarmRate::kLeastBlocks * AlarmRate::kBlock *
                                       stack.spindle.chatter.consecutive_revolutions) +
                        " revolutions");
    if (spindle && found.chatter.count() == 0)
      remarks.push_back(
          name + ": it never turns fast and steadily enough to learn the chatter thresholds");
    if (const std::string lacks = found.collision.shortage(); !lacks.empty())
      remarks.push_back(name + ": " + lacks);
    const bool lines = found.lines && found.lines->count() > 0;
    if (!found.parameters && found.collision.count() + found.chatter.count() == 0 && !lines)
      continue;
    write_found(*machine, found, slot.observer.disturbance_cutoff_rad_s);
    if (found.pairs)
      write_pairs(*machine, record.channel, *found.pairs, found.backlash_helps,
                  found.parameters ? found.parameters->inertia.value : 0,
                  1 / record.sample_period_s, remarks);
    for (std::string& removed : write_learned_under(*machine, stack, record.channel))
      remarks.push_back(std::move(removed));
    all.push_back(std::move(found));
  }
  if (all.empty()) return fail(*first_error);
  auto sensors = learn_sensors(*machine, *plan, trace_path, source->sample_period_s(), remarks);
  if (!sensors) return fail(sensors.error());
  for (const SensorFound& found : *sensors)
    write_sensor(*machine, found, source->sample_period_s(), rate->value_or(kAcceptedAlarmsPerHour),
                 remarks);
  if (auto done = machine->write(arguments.at("--out")); !done) return fail(done.error());
  if (!arguments.quiet())
    for (const std::string& remark : remarks) note(remark);
  if (arguments.json()) {
    print_idle_json(all, *sensors, remarks, arguments.at("--out"));
    return 0;
  }
  for (const IdleFound& found : all) print_found(found);
  for (const SensorFound& found : *sensors) print_sensor(found);
  say("written to %s\n", arguments.at("--out").c_str());
  say("next: %s\n", next_step(all, arguments.at("--out")).c_str());
  return 0;
}

}  // namespace

Program identify_idle_program() {
  return {
      {"identify idle",
       "nominal parameters, noise floor and thresholds from an idling run",
       {{"--machine", "FILE", "machine file to start from", true, FileUse::input},
        {"--trace", "FILE", "trace of the machine moving without cutting", true, FileUse::input},
        {"--out", "FILE", "machine file to write, with what was found", true, FileUse::output},
        {"--false-alarm-rate-per-hour", "N",
         "accepted rate of false alarms, of thresholds and floor (0.01)", false}},
       "",
       "Record at least a few seconds of moves in both directions, at two speeds or more that "
       "differ by\n"
       "a factor of three, with hard acceleration, and nothing in the cut."},
      run_identify_idle};
}

}  // namespace servosense::cli
