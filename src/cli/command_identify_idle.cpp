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
#include "idle_pairs.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/identify/cut_evidence.hpp"
#include "servosense/identify/effort_sign.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/identify/idle_signs.hpp"
#include "servosense/identify/learn_thresholds.hpp"
#include "servosense/identify/power_losses.hpp"
#include "servosense/identify/torque_path.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/monitors/collision_keys.hpp"
#include "servosense/monitors/learned_under.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/observer/machine_config.hpp"
#include "slow_chatter_watch.hpp"
#include "stack_signals.hpp"

namespace servosense::cli {
namespace {

constexpr const char* kProvenance = "servosense identify idle";

/// What was learned of one drive, as printed.
struct Found {
  Channel channel = Channel::spindle;
  std::string unit;                              // of its effort
  std::optional<RunningEffort> running;          // where speeds do not tell friction apart
  std::optional<IdleIdentification> parameters;  // nothing: the motion shows thresholds alone
  std::optional<TorquePath> path;                // with the parameters
  LearnedCollision collision;
  LearnedChatter chatter;
  std::optional<LearnedVibration> lines;  // of a slow record
  std::optional<ToothNoise> tooth;
  std::optional<FoundLosses> power;  // where the effort is one
  double cutting_torque_Nm = 0;
  bool torque_constant_sought = false;
  bool load_helps = true;  // the monitors read less with the constant load
  std::optional<LearnedPairs> pairs;
  bool backlash_helps = false;  // likewise with the backlash that motor and load show
};

/// Names of what is found, in the file and in JSON.
struct Keys {
  const char *inertia, *viscous, *coulomb, *knee, *noise_floor, *smallest_step, *constant_load,
      *effort, *speed, *load_effect;
};
constexpr Keys keys_of(Channel channel) {
  return is_turning(channel) ? Keys{"inertia_kg_m2",       "viscous_friction_Nm_s_per_rad",
                                    "coulomb_friction_Nm", "friction_knee_rad",
                                    "noise_floor_Nm",      "smallest_step_Nm",
                                    "constant_load_Nm",    "effort_Nm",
                                    "speed_rad_s",         "torque_Nm"}
                             : Keys{"equivalent_mass_kg", "viscous_friction_N_s_per_m",
                                    "coulomb_friction_N", "friction_knee_m",
                                    "noise_floor_N",      "smallest_step_N",
                                    "constant_load_N",    "effort_N",
                                    "speed_m_s",          "force_N"};
}

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

/// A load that its error cannot tell from nothing is none.
bool is_load(const IdleIdentification& idle) {
  return idle.constant_load_fitted &&
         std::abs(idle.constant_load.value) >= 3 * idle.constant_load.standard_error;
}

std::string weakening_section(Channel channel) {
  return "effect." + std::string(name_of(channel)) + ".field-weakening";
}

void take_out(DriveEffectsConfig& effects, std::string_view name) {
  for (std::size_t e = 0; e < effects.count; ++e)
    if (effects.settings[e].effect == drive_effect_index(name)) {
      effects.settings[e] = effects.settings[--effects.count];
      return;
    }
}

/// How the torque constant falls with speed, and up to which it is known.
void write_torque_constant(MachineFile& machine, const Found& found) {
  const IdleIdentification& idle = *found.parameters;
  if (!found.torque_constant_sought) return;
  constexpr const char* kKnown = "torque_constant_known_to_rpm";
  if (idle.constant_known_to > 0)
    machine.set(section_of(found.channel), kKnown, rounded(rpm_from_rad_s(idle.constant_known_to)),
                "as far as it was accelerated");
  else
    machine.remove(section_of(found.channel), kKnown);
  const std::string section = weakening_section(found.channel);
  if (!idle.field_weakening) {
    if (machine.text(section, "provenance") == kProvenance) machine.remove_section(section);
    return;
  }
  machine.remove_section(section);
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
  machine.set(section, "provenance", kProvenance);
}

void write_constant_load(MachineFile& machine, const Found& found) {
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
  machine.set(effect, keys_of(found.channel).load_effect, rounded(idle.constant_load.value),
              plus_minus(idle.constant_load));
  machine.set(effect, "provenance", kProvenance);
  if (!found.load_helps)
    machine.set(effect, "used_by_monitors", "no");
  else if (machine.has(effect, "used_by_monitors"))
    machine.set(effect, "used_by_monitors", "yes");
}

/// As the machine file lists them.
std::string phase_thresholds(const Found& found) {
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

/// Of false alarms, as people read it.
std::string rate_text(double per_hour) {
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
template <typename Learned>
std::string rate_of(const Learned& learned) {
  return rate_text(learned.alarms_per_hour());
}

void write_losses(MachineFile& machine, const std::string& section, const FoundLosses& power) {
  for (const auto& [key, loss] : {std::pair{"power_loss_W", &power.constant_W},
                                  std::pair{"copper_loss_W_per_Nm2", &power.copper_W_per_Nm2}}) {
    if (loss->value > 0)
      machine.set(section, key, rounded(loss->value), plus_minus(*loss));
    else
      machine.remove(section, key);
  }
  machine.set(section, "power_known_from_rpm", rounded(rpm_from_rad_s(power.known_from_rad_s)),
              "slower, its noise is more than 5 % of the largest torque");
}

void write_parameters(MachineFile& machine, const Found& found, double cutoff) {
  const std::string name{name_of(found.channel)}, section{section_of(found.channel)};
  const Keys keys = keys_of(found.channel);
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
  if (found.power) write_losses(machine, section, *found.power);

  const std::string floor = "detectability." + name;
  machine.set(floor, keys.noise_floor, rounded(idle.floor.noise_rms));
  machine.set(floor, keys.smallest_step, rounded(idle.floor.smallest_step));
  machine.set(floor, "false_alarm_rate_per_hour", idle.floor.false_alarm_rate_per_hour);
  machine.set(floor, "cutoff_rad_s", cutoff);
  machine.set(floor, "provenance", kProvenance);
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

void write_found(MachineFile& machine, const Found& found, double cutoff) {
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
  if (any) machine.set(monitor, "provenance", kProvenance);
  if (found.cutting_torque_Nm > 0)
    machine.set("monitor.collision", "cutting_torque_Nm", rounded(found.cutting_torque_Nm),
                "idle, half as much again");
  if (found.tooth && found.tooth->tooth.sigma() > 0) {
    const double noise = found.tooth->tooth.sigma();
    machine.set("monitor.ar-breakage", "noise_Nm", rounded(noise));
    machine.set("monitor.ar-breakage", "provenance", kProvenance);
    machine.set("monitor.tooth-breakage", "noise_Nm", rounded(noise));
    machine.set("monitor.tooth-breakage", "sample_noise_Nm", rounded(found.tooth->sample.sigma()));
    machine.set("monitor.tooth-breakage", "provenance", kProvenance);
  }
}

std::string rpm_text(double rad_s) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g rpm", rpm_from_rad_s(rad_s));
  return text;
}

void print_parameters(const IdleIdentification& idle, bool turns, const std::string& unit) {
  // Where the effort is no torque or force, inertia is what it takes for an acceleration.
  const bool mechanical = unit == "Nm" || unit == "N";
  const std::string inertia = !mechanical ? derived_unit(unit, turns ? " s2/rad" : " s2/m")
                              : turns     ? "kg m2"
                                          : "kg";
  print_row(turns ? "inertia" : "equivalent mass", idle.inertia, inertia);
  print_row("viscous friction", idle.viscous, derived_unit(unit, turns ? " s/rad" : " s/m"));
  print_row("Coulomb friction", idle.coulomb, unit);
  if (idle.constant_load_fitted) print_row("constant load", idle.constant_load, unit);
  for (const auto& [speed, ratio] : idle.current_per_torque)
    print_row("current per torque", ratio, ("at " + rpm_text(speed)));
  if (idle.field_weakening && idle.current_per_torque.empty()) {
    print_row("base speed", idle.base_speed, "rad/s");
    print_row("torque falls beyond as", idle.weakening_exponent, "(exponent)");
  }
  say("  residual               %12.4g %s (%.3g %% of the change of the effort)\n",
      idle.residual_rms, unit.c_str(), 100 * idle.residual_share);
  say("  noise floor            %12.4g %s rms, peak %.4g\n", idle.floor.noise_rms, unit.c_str(),
      idle.floor.noise_peak);
  say("  smallest step seen     %12.4g %s at %.3g false alarms an hour\n", idle.floor.smallest_step,
      unit.c_str(), idle.floor.false_alarm_rate_per_hour);
}

void print_found(const Found& found) {
  const bool turns = is_turning(found.channel);
  const std::string name{name_of(found.channel)};
  const std::string& unit = found.unit;
  if (found.parameters) {
    say("%s, %.3g s in motion, fitted at %.4g rad/s\n", name.c_str(), found.parameters->motion_s,
        found.parameters->fit_cutoff_rad_s);
    print_parameters(*found.parameters, turns, unit);
    if (found.power) {
      print_row("power without torque", found.power->constant_W, "W");
      print_row("copper loss", found.power->copper_W_per_Nm2, "W/Nm2");
      say("  power tells the torque from %s on\n", rpm_text(found.power->known_from_rad_s).c_str());
    }
    say("  %s\n", found.path->sentence().c_str());
  } else {
    say("%s, thresholds alone\n", name.c_str());
    if (found.running)
      say("  %-22s %12.6g %s at %.4g %s (friction, and a load if there is one)\n", "running effort",
          found.running->effort, unit.c_str(), found.running->speed, turns ? "rad/s" : "m/s");
  }
  auto threshold = [](const char* what, const auto& t, const std::string& of) {
    if (t.threshold() > 0)
      say("  %-22s %12.4g %s, %s\n", what, t.threshold(), of.c_str(), rate_of(t).c_str());
  };
  threshold("collision threshold", found.collision, derived_unit(unit, "/s"));
  threshold("chatter threshold", found.chatter, derived_unit(unit, "2"));
  if (found.lines) threshold("line threshold", *found.lines, derived_unit(unit, "2"));
  if (found.cutting_torque_Nm > 0)
    say("  %-22s %12.4g %s\n", "torque of a cut", found.cutting_torque_Nm, unit.c_str());
  if (found.tooth)
    say("  %-22s %12.4g %s\n", "noise of a tooth", found.tooth->tooth.sigma(), unit.c_str());
  if (found.pairs) print_pairs(found.channel, *found.pairs);
}

/// What comes next: what the idling run cannot teach, or the watch itself.
std::string next_step(const std::vector<Found>& all, const std::string& out) {
  bool axis = false;
  for (const Found& found : all) axis = axis || found.collision.threshold() > 0;
  if (!axis) return "'servosense monitor --machine " + out + " --trace TRACE'";
  return "collision is unarmed in the cut until it has seen a sound part: 'servosense identify "
         "collision --machine " +
         out + " --out OUT2 TRACE...'";
}

void print_json(const std::vector<Found>& all, const std::vector<std::string>& remarks,
                const std::string& out) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("out", out);
  json.key("drives");
  json.begin_array();
  for (const Found& found : all) {
    json.begin_object();
    json.member("channel", std::string_view(name_of(found.channel)));
    auto estimate = [&](const char* key, const Estimate& e) { write_estimate(json, key, e); };
    const Keys keys = keys_of(found.channel);
    json.member("parameters_learned", found.parameters.has_value());
    if (found.parameters) {
      estimate(keys.inertia, found.parameters->inertia);
      estimate(keys.viscous, found.parameters->viscous);
      estimate(keys.coulomb, found.parameters->coulomb);
      if (found.parameters->constant_load_fitted)
        estimate(keys.constant_load, found.parameters->constant_load);
      json.member(keys.knee, found.parameters->friction_knee);
      if (found.torque_constant_sought)
        json.member("torque_constant_known_to_rpm",
                    rpm_from_rad_s(found.parameters->constant_known_to));
      json.objects("current_per_torque", found.parameters->current_per_torque,
                   [&](const auto& knot) {
                     json.member("speed_rad_s", knot.first);
                     json.member("ratio", knot.second.value);
                     json.member("standard_error", knot.second.standard_error);
                   });
      if (found.parameters->field_weakening && found.parameters->current_per_torque.empty()) {
        estimate("base_speed_rad_s", found.parameters->base_speed);
        estimate("exponent", found.parameters->weakening_exponent);
      }
      if (found.power) {
        estimate("power_loss_W", found.power->constant_W);
        estimate("copper_loss_W_per_Nm2", found.power->copper_W_per_Nm2);
        json.member("power_known_from_rpm", rpm_from_rad_s(found.power->known_from_rad_s));
      }
      const TorquePath& path = *found.path;
      if (path.told) {
        estimate("current_delay_s", path.delay_s);
        if (path.filtered()) estimate("current_filter_hz", path.filter_hz);
        json.member("current_shows_half_to_hz", path.half_to_hz);
      }
      if (path.update_hz > 0) json.member("current_update_hz", path.update_hz);
      json.member("torque_path", path.sentence());
      json.member("residual_rms", found.parameters->residual_rms);
      json.member("residual_share", found.parameters->residual_share);
      json.member("motion_s", found.parameters->motion_s);
      json.member("noise_floor", found.parameters->floor.noise_rms);
      json.member("noise_peak", found.parameters->floor.noise_peak);
      json.member("smallest_step", found.parameters->floor.smallest_step);
      json.member("false_alarm_rate_per_hour", found.parameters->floor.false_alarm_rate_per_hour);
    }
    if (found.running) {
      json.key("running_effort");
      json.begin_object();
      json.member(keys.effort, found.running->effort);
      json.member(keys.speed, found.running->speed);
      json.end_object();
    }
    json.member("unit", found.unit);
    if (found.collision.threshold() > 0) {
      json.member(is_turning(found.channel) ? "collision_threshold_Nm_per_s"
                                            : "collision_threshold_N_per_s",
                  found.collision.threshold());
      json.member("collision_false_alarms_per_hour", found.collision.alarms_per_hour());
    }
    if (found.chatter.threshold() > 0) {
      json.member("chatter_threshold_Nm2", found.chatter.threshold());
      json.member("chatter_false_alarms_per_hour", found.chatter.alarms_per_hour());
    }
    if (found.lines && found.lines->threshold() > 0) {
      json.member("line_threshold_Nm2", found.lines->threshold());
      json.member("line_false_alarms_per_hour", found.lines->alarms_per_hour());
      json.values("own_lines_hz", found.lines->own_lines_hz);
    }
    if (found.cutting_torque_Nm > 0) json.member("cutting_torque_Nm", found.cutting_torque_Nm);
    if (found.tooth) json.member("tooth_noise_Nm", found.tooth->tooth.sigma());
    if (found.pairs) write_pairs_json(json, found.channel, *found.pairs);
    json.end_object();
  }
  json.end_array();
  json.values("remarks", remarks);
  json.member("next_step", next_step(all, out));
  json.end_object();
  std::cout << '\n';
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
    if (found_by.starts_with(kProvenance)) take_out(observer.drive.effects, name);
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
  auto rows = trace_rows(std::move(*reader));
  auto efforts = std::make_shared<EffortPairs>(*machine, rows->signals(), false);
  PairRecorder paired;
  auto source = SampleSource::open(paired.tap(EffortPairs::tap(std::move(rows), efforts), *machine),
                                   trace_path, SampleSource::kMaxFill, choices);
  if (!source) return fail(source.error());
  source->also_used(paired.columns());
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
  std::vector<Found> all;
  std::optional<Error> first_error;
  Progress learning("learning", arguments.quiet());
  for (DriveRecord& record : *records) {
    learning.show(std::string(name_of(record.channel)),
                  static_cast<std::size_t>(&record - records->data()) + 1, records->size());
    const bool spindle = is_spindle(record.channel), turns = is_turning(record.channel);
    const bool has_tool = record.channel == Channel::spindle;
    const std::string name(name_of(record.channel)), section(section_of(record.channel));
    const HostStackConfig& stack = plan->stack_of(record.channel);
    HostDriveSlotConfig slot = slot_of(record);
    // What an earlier run found of these is found anew.
    take_out(slot.observer.drive.effects, "constant-load");
    const PairRecord* const pair_record = paired.of(record.channel);
    if (pair_record != nullptr) take_out_found_by_pairs(*machine, record.channel, slot.observer);
    if (machine->text(weakening_section(record.channel), "provenance") == kProvenance)
      take_out(slot.observer.drive.effects, "field-weakening");
    IdleOptions options;
    options.seek_field_weakening = spindle && slot.observer.drive.effort_per_ampere > 0 &&
                                   slot.observer.drive.effects.find("field-weakening") == nullptr;
    if (*rate) options.false_alarm_rate_per_hour = **rate;
    const bool fixed = machine->has(section, keys_of(record.channel).knee);
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
      if (auto lost = find_power_losses(slot.observer, record, slowest_rad_s, options))
        losses = *lost;
    options.constant_loss = losses && losses->constant_W.value > 0;
    options.copper_loss = losses && losses->copper_W_per_Nm2.value > 0;
    if (const auto cut = effort_jumps(record)) return fail(not_idle(trace_path, record, *cut));
    IdleRefusal why = IdleRefusal::none;
    auto idle = identify_idle(slot.observer, record, options, &why);
    Found found;
    found.channel = record.channel;
    found.unit = effort_unit(*machine, record.channel);
    found.power = losses;
    found.torque_constant_sought = spindle && slot.observer.drive.effort_per_ampere > 0;
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
  if (auto done = machine->write(arguments.at("--out")); !done) return fail(done.error());
  if (!arguments.quiet())
    for (const std::string& remark : remarks) note(remark);
  if (arguments.json()) {
    print_json(all, remarks, arguments.at("--out"));
    return 0;
  }
  for (const Found& found : all) print_found(found);
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
