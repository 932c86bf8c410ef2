// Machine files of drives that are wrong: an effect that the machine does not have, or a number
// that is another machine's. Nothing is missing in the model, so no name is right.
#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "draw.hpp"

namespace blind {

/// What the sizes of an effect are taken from, in the units of the channel.
struct FileScale {
  bool turns = false;
  double coulomb = 1, top_speed = 1, turn = 0.01, small = 1e-6;
};

inline const std::vector<std::string>& foreign_effects() {
  static const std::vector<std::string> all{"torque-ripple", "backlash", "flexible-coupling",
                                            "stribeck-friction", "constant-load"};
  return all;
}

/// Numbers of the file that no fit of inertia and friction sets right.
inline const std::vector<std::string>& wrong_numbers() {
  static const std::vector<std::string> all{"effort-constant", "encoder-counts", "knee",
                                            "controller"};
  return all;
}

/// The section of an effect that the machine does not have.
inline std::string foreign_section(const std::string& name, const FileScale& s, Draw& draw) {
  const std::string channel = s.turns ? "spindle" : "x";
  std::string text = "\n[effect." + channel + "." + name + "]\n";
  const auto put = [&](const char* axis, const char* spindle, double value) {
    char line[96];
    std::snprintf(line, sizeof line, "%s = %.6g\n", s.turns ? spindle : axis, value);
    text += line;
  };
  const double force = s.coulomb * draw.log_uniform(0.05, 0.5);
  if (name == "torque-ripple") {
    put("order", "order", draw.one_of({1.0, 2.0, 4.0, 6.0, 12.0}));
    put("amplitude_N", "amplitude_Nm", force);
    put("phase_rad", "phase_rad", draw.uniform(-3, 3));
  } else if (name == "backlash") {
    put("width_m", "width_rad", s.small * draw.log_uniform(5, 60));
  } else if (name == "flexible-coupling") {
    put("resonance_hz", "resonance_hz", draw.log_uniform(30, 120));
    put("damping_ratio", "damping_ratio", draw.log_uniform(0.02, 0.1));
    put("mass_share", "inertia_share", draw.uniform(0.2, 0.7));
  } else if (name == "stribeck-friction") {
    put("extra_static_N", "extra_static_Nm", force);
    put("stribeck_velocity_m_per_s", "stribeck_velocity_rad_per_s",
        s.top_speed * draw.log_uniform(0.01, 0.06));
  } else if (name == "constant-load") {
    put("force_N", "torque_Nm", draw.sign() * force);
  }
  return text;
}

}  // namespace blind
