#include "servosense/monitors/pair_config.hpp"

#include <cmath>

#include "servosense/io/text.hpp"
#include "servosense/observer/machine_config.hpp"

namespace servosense {
namespace {

std::string side(Channel channel, bool second) {
  return std::string(name_of(second ? second_motor_of(channel) : channel));
}

std::string what_it_watches(PairKind kind, Channel channel) {
  const std::string name(name_of(channel));
  switch (kind) {
    case PairKind::load:
      return "watches what lies between motor and load";
    case PairKind::skew:
      return "watches whether " + name + " and " + side(channel, true) + " rack";
    case PairKind::skew_effort:
      return "watches whether the motors of " + name + " push against each other";
    case PairKind::following:
      return "watches the following error";
    case PairKind::command:
      return "watches whether the drive gives what it is told to";
  }
  return {};
}

}  // namespace

std::string pair_section(Channel channel) {
  return "monitor.signal." + std::string(name_of(channel));
}

const char* pair_unit(PairKind kind, Channel channel) {
  const bool turns = is_turning(channel);
  if (is_distance(kind)) return turns ? "rad" : "m";
  return turns ? "Nm" : "N";
}

PairKeys pair_keys(PairKind kind, Channel channel) {
  std::string name(name_of(kind));
  if (const std::size_t dash = name.find('-'); dash != std::string::npos) name[dash] = '_';
  return {name + "_band_" + pair_unit(kind, channel), name + "_terms"};
}

Expected<PairScaling> pair_scaling(const MachineFile& machine, const PairedColumns& columns) {
  auto drive = drive_config(machine, columns.channel);
  if (!drive) return drive.error();
  const auto input_of = [&](EffortKind effort) {
    DriveSignal signal = columns.drive.signal;
    signal.effort = effort;
    return drive->input(signal, 1e-3);
  };
  const DriveInputConfig input = input_of(columns.drive.signal.effort);
  PairScaling s;
  s.unit_per_count = input.unit_per_count;
  s.counter_bits = input.counter_bits;
  s.effort_per_unit = columns.drive.effort_scale * input.effort_per_unit;
  if (columns.command)
    s.command_per_unit = columns.command->scale * input_of(columns.command->kind).effort_per_unit;
  const DriveModelConfig model = drive->disturbance_observer(1e-3, drive->observer()).drive;
  s.knee = model.friction_knee;
  s.unit_per_turn = model.unit_per_turn;
  if (columns.drive.signal.motion == MotionKind::counts && !(std::abs(s.unit_per_count) > 0))
    return data_error(machine.where(section_of(columns.channel)) + ": [" +
                      std::string(section_of(columns.channel)) +
                      "] needs encoder_counts_per_rev to scale its counts");
  return s;
}

bool has_pair(const PairedColumns& c, PairKind kind) {
  switch (kind) {
    case PairKind::load:
      return c.load.has_value();
    case PairKind::skew:
      return c.second_motion.has_value();
    case PairKind::skew_effort:
      return c.second_effort.has_value();
    case PairKind::following:
      return c.following.has_value();
    case PairKind::command:
      return c.command.has_value();
  }
  return false;
}

Expected<std::vector<PlannedPair>> plan_pairs(const MachineFile& machine,
                                              const PairedColumns& columns) {
  const Channel channel = columns.channel;
  const std::string section = pair_section(channel);
  const auto terms_of = [&](const std::string& key) -> Expected<PairTerms> {
    const auto list = machine.list(section, key);
    if (!list) return PairTerms{};
    if (const auto terms = PairTerms::from(*list)) return *terms;
    return data_error(machine.where(section, key) + ": " + key + " takes 7 or 13 numbers, not " +
                      std::to_string(list->size()) + "; let 'servosense identify idle' write them");
  };
  const auto idle_effort = terms_of(kIdleEffortTerms);
  if (!idle_effort) return idle_effort.error();
  const auto drive = drive_config(machine, channel);
  if (!drive) return drive.error();
  const double limit_A =
      machine.number("controller." + std::string(name_of(channel)), "current_limit_A").value_or(0);
  std::vector<PlannedPair> all;
  for (std::size_t k = 0; k < kPairKinds; ++k) {
    PlannedPair p;
    p.kind = static_cast<PairKind>(k);
    if (!has_pair(columns, p.kind)) continue;
    const PairKeys keys = pair_keys(p.kind, channel);
    const auto terms = terms_of(keys.terms);
    if (!terms) return terms.error();
    p.config.kind = p.kind;
    p.config.terms = *terms;
    p.config.idle_effort = *idle_effort;
    p.config.band = machine.number(section, keys.band).value_or(0);
    p.config.effort_limit = std::abs(limit_A * drive->effort_per_ampere());
    if (!machine.flag("monitor.signal", "enabled").value_or(true) ||
        !machine.flag(section, "enabled").value_or(true))
      p.reason = "is switched off in the machine file";
    else if (!(p.config.band > 0))
      p.reason = "has no " + keys.band +
                 "; 'servosense identify idle' learns it from an idling "
                 "run with the same columns";
    else {
      p.runs = true;
      p.reason = what_it_watches(p.kind, channel) + ": sees from " + printed(p.config.band) + " " +
                 pair_unit(p.kind, channel) + " on";
      if (p.kind == PairKind::following && !(p.config.effort_limit > 0))
        p.reason += "; current_limit_A in [controller." + std::string(name_of(channel)) +
                    "] would tell when its effort is at the limit";
    }
    all.push_back(std::move(p));
  }
  return all;
}

std::string pair_text(const PairWatch& watch, Channel channel, bool beyond) {
  const PairKind kind = watch.config().kind;
  const std::string axis =
      is_axis(channel) ? "axis " + std::string(name_of(channel)) : std::string(name_of(channel));
  const std::string unit = pair_unit(kind, channel);
  const auto size = [&](double value) { return printed(std::abs(value)) + " " + unit; };
  const double excess = watch.value() - watch.allowed();
  switch (kind) {
    case PairKind::load:
      if (!beyond) return "motor and load of " + axis + " stay together again";
      return "motor and load of " + axis + " have come apart by " + size(watch.value()) + ", " +
             size(excess) +
             " more than backlash, windup and counts explain: an encoder slips, or belt or "
             "coupling gives way";
    case PairKind::skew:
      if (!beyond) return "the sides of " + axis + " stay together again";
      return "the gantry of " + axis + " racks: its sides have come apart by " +
             size(watch.value()) + ", a guide binds or an encoder drifts";
    case PairKind::skew_effort: {
      if (!beyond) return "the motors of " + axis + " share the load as before";
      // Friction turns round with the motion.
      const bool second = watch.residual() * watch.disturbance() < 0;
      // A guide that binds costs effort in all; motors against each other cost none.
      const bool binds = std::abs(watch.disturbance()) > 0.5 * std::abs(watch.residual());
      return binds ? side(channel, second) + " gives " + size(watch.residual()) +
                         " more than the other motor, which " + axis +
                         " needs in all: a guide binds on its side"
                   : side(channel, !second) + " and " + side(channel, second) +
                         " push against each other by " + size(watch.residual() / 2) +
                         ": the gantry racks";
    }
    case PairKind::following:
      if (!beyond) return axis + " follows its command as in the idling run";
      return axis + " is " + size(watch.residual()) +
             " further off its command than in the idling run" +
             (watch.saturated() ? " while its effort is at the limit: it pushes against something"
                                : "");
    case PairKind::command:
      if (!beyond) return axis + " gives what it is told to";
      return axis + " gives " + size(watch.residual()) +
             (watch.saturated() ? " off what it is told to: it is at its limit"
                                : " off what it is told to: switched off, in an alarm, or limited");
  }
  return {};
}

}  // namespace servosense
