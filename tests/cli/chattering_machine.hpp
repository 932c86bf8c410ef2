// A machine whose tool chatters, and what its thresholds are learned from: the shipped one of Koike
// (2016) with another tool, cut and structure, and better sensors.
#pragma once

#include <string>

#include "check.hpp"
#include "program.hpp"

namespace chattering_machine {

using namespace program_test;

struct Given {
  int teeth;
  double rpm, depth_m, mode_hz;
};

inline std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const auto at = text.find(what);
  CHECK(at != std::string::npos);
  return at == std::string::npos ? text : text.replace(at, what.size(), by);
}

inline std::string machine_of(const Given& g) {
  std::string text = content("examples/machines/koike_cut.ini");
  text = replaced(text, "teeth = 2", "teeth = " + std::to_string(g.teeth));
  text = replaced(text, "spindle_speed_rpm = 7200", "spindle_speed_rpm = " + std::to_string(g.rpm));
  text = replaced(text, "axial_depth_m = 0.015", "axial_depth_m = " + std::to_string(g.depth_m));
  text = replaced(text, "radial_immersion_m = 0.0005", "radial_immersion_m = 0.004");
  text = replaced(text, "spindle_speed_profile = -50 %/s of 7200 from 9000 to 5400\n", "");
  for (int axis = 0; axis < 2; ++axis)
    text = replaced(text, "2082 0.018 0.043", std::to_string(g.mode_hz) + " 0.03 0.2");
  text = replaced(text, "encoder_counts_per_rev = 131072", "encoder_counts_per_rev = 8388608");
  return replaced(text, "current_update_hz = 2000", "current_update_hz = 8000");
}

/// Writes idle.csv, a run of machine file `machine` in the air, and learned.ini, the file with the
/// thresholds from it.
inline void learn(const std::string& machine) {
  std::string moves = "x limits 0.5 3 100\nx start 0\nspindle limits 900 2000 1e6\n";
  for (int lap = 0; lap < 3; ++lap)
    moves +=
        "x move 0.3 0.3\nx dwell 0.2\nx move 0 0.1\nx dwell 0.2\nx move 0.2 0.02\nx move 0 0.2\n"
        "spindle cruise 300 1\nspindle cruise 800 1\nspindle cruise 100 1\n";
  put("moves.txt", moves);
  Outcome o = run("simulate drive --machine " + machine + " --motion moves.txt --out idle.csv");
  that(o.status == 0, o, "runs idle", __LINE__);
  o = run("identify idle --machine " + machine + " --trace idle.csv --out learned.ini");
  that(o.status == 0, o, "learns", __LINE__);
}

}  // namespace chattering_machine
