// What an idling run told of a drive, on the screen and as JSON.
#include <cmath>
#include <cstdio>
#include <iostream>

#include "console.hpp"
#include "effort_unit.hpp"
#include "estimate_text.hpp"
#include "idle_found.hpp"
#include "idle_pairs.hpp"
#include "sensor_watches.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/json.hpp"

namespace servosense::cli {
namespace {

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

void print_over_temperature(const IdleFound& found) {
  if (!found.over_temperature || !found.over_temperature->refusal.empty()) return;
  const SeenConstantOverTemperature& seen = *found.over_temperature;
  if (seen.per_K)
    print_row("torque per ampere, per K", *seen.per_K, "1/K");
  else
    say("  torque per ampere does not go with the motor's temperature");
  say("  between %.3g and %.3g degC\n", seen.lowest_C, seen.highest_C);
}

void print_saturation(const IdleFound& found) {
  const IdleIdentification& idle = *found.parameters;
  if (idle.torque_saturation) {
    print_row("torque holds up to", in_ampere(idle.saturation_knee, found), "A");
    print_row("lost of it beyond", idle.saturation_share, "(share)");
  } else if (idle.saturation_seen_to > 0) {
    say("  torque per ampere is the same up to %.3g A, within %.2g %%\n",
        idle.saturation_seen_to / found.ampere, 200 * idle.saturation_seen_error);
  }
}

}  // namespace

void print_found(const IdleFound& found) {
  const bool turns = is_turning(found.channel);
  const std::string name{name_of(found.channel)};
  const std::string& unit = found.unit;
  if (found.parameters) {
    say("%s, %.3g s in motion, fitted at %.4g rad/s\n", name.c_str(), found.parameters->motion_s,
        found.parameters->fit_cutoff_rad_s);
    print_parameters(*found.parameters, turns, unit);
    print_saturation(found);
    print_over_temperature(found);
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

std::string next_step(const std::vector<IdleFound>& all, const std::string& out) {
  bool axis = false;
  for (const IdleFound& found : all) axis = axis || found.collision.threshold() > 0;
  if (!axis) return "'servosense monitor --machine " + out + " --trace TRACE'";
  return "collision is unarmed in the cut until it has seen a sound part: 'servosense identify "
         "collision --machine " +
         out + " --out OUT2 TRACE...'";
}

void print_idle_json(const std::vector<IdleFound>& all, const std::vector<SensorFound>& sensors,
                     const std::vector<std::string>& remarks, const std::string& out) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("out", out);
  json.key("drives");
  json.begin_array();
  for (const IdleFound& found : all) {
    json.begin_object();
    json.member("channel", std::string_view(name_of(found.channel)));
    auto estimate = [&](const char* key, const Estimate& e) { write_estimate(json, key, e); };
    const IdleKeys keys = idle_keys(found.channel);
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
      if (found.saturation_sought) {
        json.member("torque_constant_seen_to_A",
                    found.parameters->saturation_seen_to / found.ampere);
        if (found.parameters->torque_saturation) {
          estimate("knee_current_A", in_ampere(found.parameters->saturation_knee, found));
          estimate("share_lost", found.parameters->saturation_share);
        }
      }
      if (found.over_temperature && found.over_temperature->refusal.empty()) {
        if (found.over_temperature->per_K)
          estimate("torque_constant_per_K", *found.over_temperature->per_K);
        json.member("motor_lowest_C", found.over_temperature->lowest_C);
        json.member("motor_highest_C", found.over_temperature->highest_C);
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
  write_sensors_json(json, sensors);
  json.values("remarks", remarks);
  json.member("next_step", next_step(all, out));
  json.end_object();
  std::cout << '\n';
}

}  // namespace servosense::cli
