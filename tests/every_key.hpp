// Every key of a machine file, each with a second legal value: for tests that walk over all of
// them.
#pragma once

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <initializer_list>
#include <sstream>
#include <string>
#include <vector>

#include "servosense/io/machine_keys.hpp"

namespace every_key {

struct Line {
  std::string section, key, value;
};

/// Those of tests/data/machine/complete.ini, where each stands once.
inline std::vector<Line> all_keys() {
  std::ifstream in("tests/data/machine/complete.ini");
  std::vector<Line> lines;
  std::string text, section;
  while (std::getline(in, text)) {
    text = text.substr(0, text.find('#'));
    while (!text.empty() && text.back() == ' ') text.pop_back();
    if (text.empty()) continue;
    if (text[0] == '[')
      section = text.substr(1, text.size() - 2);
    else
      lines.push_back({section, text.substr(0, text.find(" =")), text.substr(text.find("= ") + 2)});
  }
  return lines;
}

/// Another legal value.
inline std::string changed(const servosense::MachineKey& key, const std::string& value) {
  using servosense::KeyKind;
  if (key.kind == KeyKind::flag) return value == "yes" ? "no" : "yes";
  if (key.kind == KeyKind::word) {
    std::string choices(key.choices);
    const std::size_t at = choices.find(value);
    choices.erase(at, value.size());
    const std::size_t from = choices.find_first_not_of(' ');
    return choices.substr(from, choices.find(' ', from) - from);
  }
  if (key.kind == KeyKind::text) return value + "2";
  if (key.kind == KeyKind::integer) {
    const int n = std::stoi(value);
    if (n > 20) return std::to_string(n * 9 / 10);
    return std::to_string(n > key.range.low && n > -1 ? n - 1 : n + 1);
  }
  std::string out;
  std::istringstream in(value);
  for (std::string word; in >> word;) {
    const bool comma = word.back() == ',';
    if (comma) word.pop_back();
    char text[40];
    std::snprintf(text, sizeof text, "%.9g", 0.93 * std::stod(word));
    out += (out.empty() ? "" : " ") + std::string(text) + (comma ? "," : "");
  }
  return out;
}

inline bool any_of(const std::string& text, std::initializer_list<const char*> names) {
  return std::any_of(names.begin(), names.end(), [&](const char* name) { return text == name; });
}

/// Of a tool, for the workpiece.
inline bool is_cutter_shape(const Line& l) {
  return l.section == "tool" &&
         any_of(l.key, {"kind", "corner_radius_m", "flute_length_m", "stick_out_m",
                        "holder_diameter_m", "point_angle_deg", "taper_deg", "entering_angle_deg"});
}

/// Of programs whose torque is predicted, and whose feeds are chosen.
inline bool is_torque_law(const Line& l) {
  return l.section == "tool" && l.key.starts_with("torque_equation");
}
inline bool is_feed_limit(const Line& l) {
  return (l.section == "limits" &&
          any_of(l.key, {"torque_Nm", "power_W", "deflection_m", "feed_m_s"})) ||
         (l.section == "tool" && l.key == "cutting_speed_m_s");
}

/// Of programs that are checked.
inline bool is_program_limit(const Line& l) {
  return (l.section == "limits" && !is_feed_limit(l)) ||
         (l.section == "tool" && any_of(l.key, {"ramp_angle_deg", "length_m"}));
}

/// Of chatter by an accelerometer or a microphone, beside the stack.
inline bool is_sensor(const Line& l) {
  return any_of(l.section, {"monitor.chatter.accelerometer", "monitor.chatter.microphone"});
}

/// What only hosts use: simulation and advice, names, effects of the tool and the cut. The rest
/// reaches firmware (tests/capi/test_machine_config.cpp).
inline bool is_host_only(const Line& l) {
  const std::string& s = l.section;
  if (s == "override" || s == "cut" || s == "simulation" || s.starts_with("structure.") ||
      s.starts_with("dynamometer") || s.starts_with("detectability.") ||
      s.starts_with("effect.tool.") || s.starts_with("effect.dyno."))
    return true;
  if (any_of(s, {"effect.x.extra-mode", "effect.x.cross-talk", "effect.x.time-locked-vibration"}))
    return true;
  if (s.starts_with("effect.a.") || s == "effect.spindle.time-locked-vibration") return true;
  if (s == "monitor.collision.a") return true;  // an axis that turns
  if (s == "monitor.reference") return true;
  if (s.starts_with("monitor.signal.") || is_sensor(l)) return true;
  if (any_of(l.key, {"tool_change_s", "spindle_start_s", "waits_for_spindle",
                     "max_acceleration_m_s2", "max_jerk_m_s3"}))
    return true;
  if (l.key == "slow_signal") return true;  // below 500 Hz alone
  if (is_cutter_shape(l) || is_program_limit(l) || is_feed_limit(l)) return true;
  if (any_of(l.key, {"provenance",          "false_alarm_rate_per_hour",
                     "effort_column",       "current_is_ratio",
                     "constant_speed_rpm",  "max_speed_rpm",
                     "max_velocity_m_s",    "rated_power_W",
                     "load_meter_V_per_W",  "max_speed_rad_s",
                     "rated_torque_Nm",     "rated_current_A",
                     "current_is_unsigned", "torque_constant_known_to_rpm",
                     "load_percent_of",     "power_known_from_rpm",
                     "power_loss_W",        "copper_loss_W_per_Nm2",
                     "effort_noise_A",      "effort_noise_Nm",
                     "effort_noise_N",      "effort_noise_W",
                     "effort_share_error",  "current_filter_hz",
                     "line_threshold_Nm2",  "own_lines_hz"}))
    return true;
  if (s.starts_with("controller.")) return l.key != "current_limit_A";
  if (s == "tool") return !any_of(l.key, {"teeth", "diameter_m", "spindle"});
  return false;
}

}  // namespace every_key
