// What an idling run told of a drive, into the machine file.
#include "idle_found.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "estimate_text.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/monitors/collision_keys.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "slow_chatter_watch.hpp"

namespace servosense::cli {

bool is_load(const IdleIdentification& idle) {
  return idle.constant_load_fitted &&
         std::abs(idle.constant_load.value) >= 3 * idle.constant_load.standard_error;
}

std::string effect_section(Channel channel, const std::string& effect) {
  return "effect." + std::string(name_of(channel)) + "." + effect;
}

std::string saturation_remark(const IdleFound& found) {
  if (!found.parameters || !found.saturation_sought || found.parameters->saturation_seen_to > 0 ||
      found.parameters->torque_saturation)
    return {};
  char text[200];
  std::snprintf(text, sizeof text,
                ": the accelerations take currents too much alike (up to %.3g A) to tell whether "
                "torque per ampere falls with current; record run-ups at a quarter, half and all "
                "of the current",
                found.parameters->highest_effort / found.ampere);
  return std::string(name_of(found.channel)) + text;
}

Estimate in_ampere(const Estimate& effort, const IdleFound& found) {
  return {effort.value / found.ampere, effort.standard_error / found.ampere};
}

void write_losses(MachineFile& machine, const std::string& section, const FoundLosses& power,
                  const char* slower) {
  for (const auto& [key, loss] : {std::pair{"power_loss_W", &power.constant_W},
                                  std::pair{"copper_loss_W_per_Nm2", &power.copper_W_per_Nm2}}) {
    if (loss->value > 0)
      machine.set(section, key, rounded(loss->value), plus_minus(*loss));
    else
      machine.remove(section, key);
  }
  machine.set(section, "power_known_from_rpm", rounded(rpm_from_rad_s(power.known_from_rad_s)),
              slower);
}

namespace {

/// An effect is written anew, or what an earlier run found of it goes. False: there is none.
bool begin_effect(MachineFile& machine, const std::string& section, bool found) {
  if (found || machine.text(section, "provenance") == kIdleProvenance)
    machine.remove_section(section);
  return found;
}

void write_saturation(MachineFile& machine, const IdleFound& found) {
  const IdleIdentification& idle = *found.parameters;
  const std::string section = effect_section(found.channel, kSaturation);
  if (!begin_effect(machine, section, idle.torque_saturation.has_value())) return;
  const Estimate knee = in_ampere(idle.saturation_knee, found);
  machine.set(section, "knee_current_A", rounded(knee.value), plus_minus(knee));
  machine.set(section, "share_lost", rounded(idle.saturation_share.value),
              plus_minus(idle.saturation_share));
  machine.set(section, "provenance", kIdleProvenance);
}

/// How the torque constant falls with speed, and up to which it is known.
void write_torque_constant(MachineFile& machine, const IdleFound& found) {
  const IdleIdentification& idle = *found.parameters;
  if (!found.torque_constant_sought) return;
  constexpr const char* kKnown = "torque_constant_known_to_rpm";
  if (idle.constant_known_to > 0)
    machine.set(section_of(found.channel), kKnown, rounded(rpm_from_rad_s(idle.constant_known_to)),
                "as far as it was accelerated");
  else
    machine.remove(section_of(found.channel), kKnown);
  const std::string section = effect_section(found.channel, kWeakening);
  if (!begin_effect(machine, section, idle.field_weakening.has_value())) return;
  if (!idle.current_per_torque.empty()) {
    std::string pairs;
    char text[80];
    for (const auto& [speed, ratio] : idle.current_per_torque) {
      std::snprintf(text, sizeof text, "%s%.6g %.6g", pairs.empty() ? "" : ", ", speed,
                    ratio.value);
      pairs += text;
    }
    machine.set(section, "current_per_torque", pairs, "speed in rad/s, current over that at rest");
  } else {
    machine.set(section, "base_speed_rad_s", rounded(idle.base_speed.value),
                plus_minus(idle.base_speed));
    if (idle.weakening_exponent.value != 1)
      machine.set(section, "exponent", rounded(idle.weakening_exponent.value),
                  plus_minus(idle.weakening_exponent));
  }
  machine.set(section, "provenance", kIdleProvenance);
}

void write_constant_load(MachineFile& machine, const IdleFound& found) {
  const IdleIdentification& idle = *found.parameters;
  if (!idle.constant_load_fitted) return;
  const std::string name{name_of(found.channel)}, section{section_of(found.channel)};
  if (is_linear_axis(found.channel) && machine.flag(section, "vertical").value_or(false)) {
    machine.set(section, "moving_mass_kg", rounded(idle.constant_load.value / kGravity_m_s2),
                "from the constant load");
    return;
  }
  const std::string effect = "effect." + name + ".constant-load";
  if (!is_load(idle)) {
    machine.remove_section(effect);
    return;
  }
  machine.set(effect, idle_keys(found.channel).load_effect, rounded(idle.constant_load.value),
              plus_minus(idle.constant_load));
  machine.set(effect, "provenance", kIdleProvenance);
  if (!found.load_helps)
    machine.set(effect, "used_by_monitors", "no");
  else if (machine.has(effect, "used_by_monitors"))
    machine.set(effect, "used_by_monitors", "yes");
}

/// As the machine file lists them.
std::string phase_thresholds(const IdleFound& found) {
  std::string list;
  for (const auto phase : {MotionPhase::standstill, MotionPhase::constant_speed,
                           MotionPhase::acceleration, MotionPhase::reversal}) {
    char text[40];
    std::snprintf(text, sizeof text, "%.8g", found.collision.phase_threshold(phase));
    if (!list.empty()) list += ", ";
    list += text;
  }
  return list;
}

void write_parameters(MachineFile& machine, const IdleFound& found, double cutoff) {
  const std::string name{name_of(found.channel)}, section{section_of(found.channel)};
  const IdleKeys keys = idle_keys(found.channel);
  const IdleIdentification& idle = *found.parameters;
  auto set = [&](const char* key, const Estimate& e) {
    machine.set(section, key, rounded(e.value), plus_minus(e));
  };
  set(keys.inertia, idle.inertia);
  set(keys.viscous, idle.viscous);
  set(keys.coulomb, idle.coulomb);
  machine.set(section, keys.knee, idle.friction_knee);
  write_constant_load(machine, found);
  if (is_spindle(found.channel)) write_torque_constant(machine, found);
  if (found.saturation_sought) write_saturation(machine, found);
  if (found.over_temperature && found.over_temperature->per_K) {
    set("torque_constant_per_K", *found.over_temperature->per_K);
    machine.set(section, "torque_constant_at_C", found.constant.at_C);
  }
  if (found.power)
    write_losses(machine, section, *found.power,
                 "slower, its noise is more than 5 % of the largest torque");

  const std::string floor = "detectability." + name;
  machine.set(floor, keys.noise_floor, rounded(idle.floor.noise_rms));
  machine.set(floor, keys.smallest_step, rounded(idle.floor.smallest_step));
  machine.set(floor, "false_alarm_rate_per_hour", idle.floor.false_alarm_rate_per_hour);
  machine.set(floor, "cutoff_rad_s", cutoff);
  machine.set(floor, "provenance", kIdleProvenance);
}

/// How the drive reports its current. What somebody has stated of its rate stays.
void write_torque_path(MachineFile& machine, Channel channel, const TorquePath& path) {
  const std::string section{section_of(channel)};
  if (path.filtered())
    machine.set(section, "current_filter_hz", rounded(path.filter_hz.value),
                plus_minus(path.filter_hz));
  else
    machine.remove(section, "current_filter_hz");
  if (path.update_hz > 0 && !machine.has(section, "current_update_hz"))
    machine.set(section, "current_update_hz", rounded(path.update_hz), "values are held");
}

}  // namespace

std::string false_alarm_text(double per_hour) {
  if (!std::isfinite(per_hour)) return "rate of false alarms not known";
  char text[64];
  if (per_hour < 1e-3)
    std::snprintf(text, sizeof text, "below one false alarm in 1000 hours");
  else if (per_hour < 1)
    std::snprintf(text, sizeof text, "one false alarm in %.3g hours", 1 / per_hour);
  else
    std::snprintf(text, sizeof text, "%.2g false alarms an hour", per_hour);
  return text;
}

void write_found(MachineFile& machine, const IdleFound& found, double cutoff) {
  if (found.parameters) write_parameters(machine, found, cutoff);
  if (found.path) write_torque_path(machine, found.channel, *found.path);
  const bool spindle = is_spindle(found.channel);
  const std::string monitor =
      monitor_section(spindle ? MonitorId::chatter : MonitorId::collision, found.channel);
  auto learned = [&](const std::string& key, const auto& t) {
    if (!(t.threshold() > 0)) return false;
    char comment[200];
    std::snprintf(comment, sizeof comment, "idle: mean %.3g, sigma %.3g, peak %.3g; %s", t.mean(),
                  t.sigma(), t.peak(), rate_of(t).c_str());
    machine.set(monitor, key, rounded(t.threshold()), comment);
    return true;
  };
  bool any = false;
  if (spindle) {
    any = learned("chatter_threshold_Nm2", found.chatter);
    if (found.lines) {
      any = learned("line_threshold_Nm2", *found.lines) || any;
      std::string list;
      for (const double hz : found.lines->own_lines_hz)
        list += (list.empty() ? "" : ", ") + std::to_string(rounded(hz));
      if (list.empty())
        machine.remove(monitor, "own_lines_hz");
      else
        machine.set(monitor, "own_lines_hz", list, "in the air, as they appear");
    }
  } else {
    const CollisionKeys keys(found.channel);
    any = learned(keys.threshold, found.collision);
    if (any) machine.set(monitor, keys.phase_thresholds, phase_thresholds(found));
  }
  if (any) machine.set(monitor, "provenance", kIdleProvenance);
  if (found.cutting_torque_Nm > 0)
    machine.set("monitor.collision", "cutting_torque_Nm", rounded(found.cutting_torque_Nm),
                "idle, half as much again");
  if (found.tooth && found.tooth->tooth.sigma() > 0) {
    const double noise = found.tooth->tooth.sigma();
    machine.set("monitor.ar-breakage", "noise_Nm", rounded(noise));
    machine.set("monitor.ar-breakage", "provenance", kIdleProvenance);
    machine.set("monitor.tooth-breakage", "noise_Nm", rounded(noise));
    machine.set("monitor.tooth-breakage", "sample_noise_Nm", rounded(found.tooth->sample.sigma()));
    machine.set("monitor.tooth-breakage", "provenance", kIdleProvenance);
  }
}

}  // namespace servosense::cli
