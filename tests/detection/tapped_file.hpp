// The machine file of a random cut as tap test and data sheets would give it: what is known of
// tool, cut and structure is a little off.
#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "detection/random_cuts.hpp"

namespace detection {

inline std::string modes_of(detail::Draw& d, const std::vector<StructuralMode>& modes) {
  std::string text;
  for (const StructuralMode& m : modes)
    text += (text.empty() ? "" : ", ") +
            std::to_string(m.natural_frequency_hz * d.between(0.99, 1.01)) + " " +
            std::to_string(m.damping_ratio * d.between(0.8, 1.2)) + " " +
            std::to_string(m.modal_mass_kg * d.between(0.9, 1.1));
  return text;
}

/// Tool, cut and structure of the file; natural frequencies within 1 %, masses 10 %, damping 20 %.
[[nodiscard]] inline MachineFile file_of(const Cut& c) {
  detail::Draw d(c.seed + 9'000'000);
  const MillingSimulation& m = c.milling();
  const auto number = [](const char* key, double value) {
    char text[80];
    std::snprintf(text, sizeof text, "%s = %.9g\n", key, value);
    return std::string(text);
  };
  const char* direction = m.cut.direction == MillingDirection::up     ? "up"
                          : m.cut.direction == MillingDirection::down ? "down"
                                                                      : "slot";
  return good(MachineFile::parse(
                  "[machine]\nname = drawn\nsample_rate_hz = 8000\n[tool]\n" +
                      number("diameter_m", m.tool.diameter_m) + number("teeth", m.tool.teeth) +
                      number("helix_deg", m.tool.helix_deg) +
                      number("tangential_coefficient_N_per_m2",
                             m.tool.force.tangential_coefficient_N_per_m2) +
                      number("radial_ratio", m.tool.force.radial_ratio) + "[cut]\n" +
                      number("spindle_speed_rpm", m.cut.spindle_speed_rpm) +
                      number("feed_per_tooth_m", m.cut.feed_per_tooth_m) +
                      number("axial_depth_m", m.cut.axial_depth_m) +
                      number("radial_immersion_m", m.cut.radial_immersion_m) + "direction = " +
                      direction + "\n[structure.x]\nmodes = " + modes_of(d, m.structure.x) +
                      "\n[structure.y]\nmodes = " + modes_of(d, m.structure.y) + "\n",
                  "drawn.ini"),
              "file");
}

}  // namespace detection
