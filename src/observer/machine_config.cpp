#include "servosense/observer/machine_config.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

namespace servosense {
namespace {

void take(const MachineFile& machine, const std::string& section, const char* key, double& to) {
  if (const auto value = machine.number(section, key)) to = *value;
}

ObserverCutoffs cutoffs_of(const MachineFile& machine, Channel channel) {
  const std::string section = "observer." + std::string(name_of(channel));
  ObserverCutoffs c;
  take(machine, section, "disturbance_cutoff_rad_s", c.disturbance_cutoff_rad_s);
  take(machine, section, "velocity_cutoff_rad_s", c.velocity_cutoff_rad_s);
  return c;
}

unsigned counter_bits_of(const MachineFile& machine, const std::string& section) {
  return static_cast<unsigned>(machine.number(section, "counter_bits").value_or(32));
}

// A knee below four encoder counts would chatter with quantisation.
double knee_of(const MachineFile& machine, const std::string& section, const char* key,
               double standard, double unit_per_count) {
  return machine.number(section, key).value_or(std::max(standard, 4 * unit_per_count));
}

}  // namespace

EffortShare effort_share(const MachineFile& machine, Channel channel) {
  constexpr double kUsual = 0.1;  // convention: two motors alike, one in a warmer place
  const std::string section(section_of(channel));
  EffortShare s;
  s.share = machine.number(section, "effort_share").value_or(1);
  if (s.share == 1) return s;
  s.relative_error =
      machine.number(section, "effort_share_error").value_or(kUsual * s.share) / s.share;
  char text[400];
  std::snprintf(text, sizeof text,
                "%s: its motor is taken to carry %.3g +- %.2g of the effort, so estimates are what "
                "it gives over that, and no better known than to %.2g %%; a force on the other "
                "motor's side may show as less, down to nothing, one on this side as up to %.3g "
                "times as much",
                std::string(name_of(channel)).c_str(), s.share, s.share * s.relative_error,
                100 * s.relative_error, 1 / s.share);
  s.said = text;
  return s;
}

Expected<DriveEffectsConfig> drive_effects_config(const MachineFile& machine, Channel channel) {
  const std::string prefix = "effect." + std::string(name_of(channel)) + ".";
  DriveEffectsConfig config;
  for (const std::string& section : machine.sections()) {
    if (!section.starts_with(prefix)) continue;
    const std::size_t effect = drive_effect_index(section.substr(prefix.size()));
    if (effect == kDriveEffectCount) continue;
    if (config.count == kMaxActiveEffects)
      return data_error(machine.where(section) + ": a drive carries at most " +
                        std::to_string(kMaxActiveEffects) + " effects; remove one");
    EffectSetting setting;
    setting.effect = effect;
    const EffectInfo& info = kDriveEffects[effect];
    for (std::size_t p = 0; p < info.parameter_count(); ++p) {
      const EffectParameter& parameter = info.parameters[p];
      const char* key = parameter.key_for(is_turning(channel));
      std::vector<double> values;
      if (const auto list = machine.list(section, key)) {
        values = *list;
      } else if (const auto pairs = machine.pairs(section, key)) {
        for (const auto& pair : *pairs) values.insert(values.end(), pair.begin(), pair.end());
      } else if (const auto number = machine.number(section, key)) {
        values = {*number};
      } else if (parameter.optional) {
        continue;
      } else {
        return data_error(machine.where(section) + ": [" + section + "] lacks " + key +
                          "; write it, or remove the section");
      }
      if (values.size() > kMaxEffectValues)
        return data_error(machine.where(section, key) + ": " + key + " takes at most " +
                          std::to_string(kMaxEffectValues) + " numbers, not " +
                          std::to_string(values.size()));
      std::copy(values.begin(), values.end(), setting.parameters[p].value.begin());
      setting.parameters[p].count = values.size();
    }
    config.settings[config.count++] = setting;
    if (const Status status = DriveEffects<double>::validate(config); !status.ok())
      return data_error(machine.where(section, status.parameter()) + ": " + status.parameter() +
                        " " + status.reason());
  }
  return config;
}

namespace {

/// A column that stands for the effort is in whatever unit it is in.
bool effort_is_ratio(const MachineFile& machine, const std::string& section) {
  return machine.flag(section, "current_is_ratio").value_or(false) ||
         machine.has(section, "effort_column");
}

}  // namespace

Channel tool_spindle(const MachineFile& machine) {
  const bool second = machine.text("tool", "spindle") == name_of(Channel::spindle2);
  return second ? Channel::spindle2 : Channel::spindle;
}

Expected<SpindleConfig> spindle_config(const MachineFile& machine, Channel channel) {
  const std::string section(section_of(channel));
  SpindleConfig c;
  take(machine, section, "torque_constant_Nm_per_A", c.torque_constant_Nm_per_A);
  take(machine, section, "inertia_kg_m2", c.inertia_kg_m2);
  take(machine, section, "viscous_friction_Nm_s_per_rad", c.viscous_friction_Nm_s_per_rad);
  take(machine, section, "coulomb_friction_Nm", c.coulomb_friction_Nm);
  take(machine, section, "encoder_counts_per_rev", c.encoder_counts_per_rev);
  const double gear = machine.number(section, "gear_ratio").value_or(1);
  c.encoder_counts_per_rev *= gear;
  c.effort_share = effort_share(machine, channel).share;
  c.torque_constant_Nm_per_A *= gear / c.effort_share;
  c.counter_bits = counter_bits_of(machine, section);
  take(machine, section, "current_update_hz", c.current_update_hz);
  c.effort_is_ratio = effort_is_ratio(machine, section);
  if (is_rotary_axis(channel)) c.friction_knee_rad = kTableKnee_rad;
  const double count = c.encoder_counts_per_rev > 0 ? kTwoPi / c.encoder_counts_per_rev : 0;
  c.friction_knee_rad = knee_of(machine, section, "friction_knee_rad", c.friction_knee_rad, count);
  c.observer = cutoffs_of(machine, channel);
  auto effects = drive_effects_config(machine, channel);
  if (!effects) return effects.error();
  c.effects = *effects;
  return c;
}

Expected<AxisConfig> axis_config(const MachineFile& machine, Channel axis) {
  const std::string section(section_of(axis));
  AxisConfig c;
  take(machine, section, "lead_m", c.lead_m);
  c.lead_m /= machine.number(section, "gear_ratio").value_or(1);
  take(machine, section, "equivalent_mass_kg", c.equivalent_mass_kg);
  c.moving_mass_kg = c.equivalent_mass_kg;
  take(machine, section, "moving_mass_kg", c.moving_mass_kg);
  c.vertical = machine.flag(section, "vertical").value_or(false);
  take(machine, section, "viscous_friction_N_s_per_m", c.viscous_friction_N_s_per_m);
  take(machine, section, "coulomb_friction_N", c.coulomb_friction_N);
  take(machine, section, "torque_constant_Nm_per_A", c.torque_constant_Nm_per_A);
  take(machine, section, "force_constant_N_per_A", c.force_constant_N_per_A);
  c.effort_share = effort_share(machine, axis).share;
  if (c.effort_share != 1 && machine.flag(section, "gantry").value_or(false))
    return data_error(machine.where(section, "effort_share") +
                      ": effort_share is for a trace with one motor of two, gantry for one with "
                      "both; leave one of the two keys out");
  c.torque_constant_Nm_per_A /= c.effort_share;
  c.force_constant_N_per_A /= c.effort_share;
  take(machine, section, "encoder_counts_per_rev", c.encoder_counts_per_rev);
  c.counter_bits = counter_bits_of(machine, section);
  take(machine, section, "current_update_hz", c.current_update_hz);
  c.effort_is_ratio = effort_is_ratio(machine, section);
  if (c.torque_constant_Nm_per_A > 0 && !(c.lead_m > 0))
    return data_error(machine.where(section) + ": [" + section +
                      "] needs lead_m to turn the motor's torque into a force");
  const double count = c.encoder_counts_per_rev > 0 ? c.lead_m / c.encoder_counts_per_rev : 0;
  c.friction_knee_m = knee_of(machine, section, "friction_knee_m", c.friction_knee_m, count);
  c.observer = cutoffs_of(machine, axis);
  auto effects = drive_effects_config(machine, axis);
  if (!effects) return effects.error();
  c.effects = *effects;
  return c;
}

std::string leave_out_effects_of_current(Channel drive, EffortKind effort,
                                         DriveEffectsConfig& effects) {
  if (effort == EffortKind::current_A || take_out_effects_of_current(effects) == 0) return {};
  return std::string(name_of(drive)) +
         ": what the machine file says of its torque constant over speed and current is not used: "
         "the trace reports no current";
}

Expected<DriveConfig> drive_config(const MachineFile& machine, Channel channel) {
  if (is_turning(channel)) {
    auto turning = spindle_config(machine, channel);
    if (!turning) return turning.error();
    return DriveConfig(*turning);
  }
  auto linear = axis_config(machine, channel);
  if (!linear) return linear.error();
  return DriveConfig(*linear);
}

double estimate_noise(const MachineFile& machine, Channel channel, double cutoff_rad_s) {
  constexpr double kSameCutoff = 0.01;  // numerical: as the file prints it
  const std::string section = "detectability." + std::string(name_of(channel));
  const double of = machine.number(section, "cutoff_rad_s").value_or(0);
  if (std::abs(of - cutoff_rad_s) > kSameCutoff * of) return 0;
  return machine.number(section, is_turning(channel) ? "noise_floor_Nm" : "noise_floor_N")
      .value_or(0);
}

}  // namespace servosense
