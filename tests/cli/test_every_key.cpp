// A key of a machine file is used, or refused where it means nothing: what only hosts use is
// changed, one key at a time, and some command has to print something else. What reaches firmware
// is in tests/capi/test_machine_config.cpp.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "check.hpp"
#include "every_key.hpp"
#include "program.hpp"
#include "servosense/io/machine_file.hpp"

namespace {

using namespace program_test;
using every_key::Line;
using servosense::MachineFile;

/// For people: commands write them, show them or leave them alone.
bool is_a_record(const Line& l) {
  return every_key::any_of(l.key, {"provenance", "false_alarm_rate_per_hour", "material"}) ||
         l.section.starts_with("detectability.");
}

/// Named by `reconcile`, which takes them up itself; nothing else knows them. `axis a` is none that
/// a command follows yet.
bool is_named_only(const Line& l) {
  return every_key::any_of(l.section, {"effect.tool.extra-mode", "effect.x.extra-mode",
                                       "effect.dyno.sensor-resonance"}) ||
         l.section.starts_with("effect.a.");
}

const char* const kMachine = R"(
[machine]
sample_rate_hz = 8000
[spindle]
torque_constant_Nm_per_A = 0.5
inertia_kg_m2 = 0.004
viscous_friction_Nm_s_per_rad = 0.001
coulomb_friction_Nm = 0.1
encoder_counts_per_rev = 65536
[axis.x]
lead_m = 0.01
equivalent_mass_kg = 200
viscous_friction_N_s_per_m = 800
coulomb_friction_N = 90
torque_constant_Nm_per_A = 0.8
encoder_counts_per_rev = 1048576
[axis.y]
lead_m = 0.01
equivalent_mass_kg = 200
viscous_friction_N_s_per_m = 800
coulomb_friction_N = 90
torque_constant_Nm_per_A = 0.8
encoder_counts_per_rev = 1048576
[tool]
diameter_m = 0.016
teeth = 4
helix_deg = 20
tangential_coefficient_N_per_m2 = 7e8
radial_ratio = 0.3
[cut]
spindle_speed_rpm = 6000
feed_per_tooth_m = 8e-5
axial_depth_m = 0.002
radial_immersion_m = 0.008
direction = down
[simulation]
step_s = 1e-5
duration_s = 0.06
start = immersed
[structure.x]
modes = 600 0.03 12
[structure.y]
modes = 700 0.03 12
)";

const char* const kControllers = R"(
[controller.x]
position_gain_per_s = 60
velocity_gain_A_s_per_m = 250
velocity_integral_per_s = 80
[controller.y]
position_gain_per_s = 60
velocity_gain_A_s_per_m = 250
velocity_integral_per_s = 80
[controller.spindle]
velocity_gain_A_s_per_rad = 1.2
velocity_integral_per_s = 20
)";

const char* const kMonitors = R"(
[monitor.chatter]
chatter_threshold_Nm2 = 0.02
[monitor.collision]
threshold_x_N_per_s = 50000
)";

/// Signals that come in pairs: of a gantry, and of drives that say what they are told.
void put_pairs() {
  std::string sides = "t_s,x.position_m,x.current_A,x2.position_m,x2.current_A\n";
  std::string told =
      "t_s,x.angle_rad,x.current_A,x.position_m,x.following_error_m,x.command_current_A,"
      "a.angle_counts,a.torque_Nm,a.angle_rad,a.following_error_rad,a.command_torque_Nm\n";
  char row[260];
  for (int n = 0; n < 4000; ++n) {
    const double t = n * 5e-4, way = 0.1 * (1 - std::cos(4 * t)), push = std::sin(4 * t);
    std::snprintf(row, sizeof row, "%.6f,%.9f,%.6f,%.9f,%.6f\n", t, way, push, way + 1e-5 * push,
                  1.1 * push);
    sides += row;
    std::snprintf(row, sizeof row, "%.6f,%.9f,%.6f,%.9f,%.9f,%.6f,%.0f,%.6f,%.9f,%.9f,%.6f\n", t,
                  way * 2 * 3.14159265 / 0.01, push, way + 1e-5 * push, 1e-4 * push, 1.1 * push,
                  std::floor(1e6 * way), push, way, 1e-3 * push, 1.2 * push);
    told += row;
  }
  put("sides.csv", sides);
  put("y.csv", "t_s,y.position_m,y.current_A\n0,0,1\n0.000125,0,2\n0.00025,0,1\n");
  put("told.csv", told);
}

/// A long straight cut on a slant.
void put_cut() {
  std::string cut =
      "t_s,spindle.speed_rad_s,spindle.torque_Nm,x.velocity_m_s,x.force_N,y.velocity_m_s,"
      "y.force_N\n";
  char row[200];
  for (int n = 0; n < 32000; ++n) {
    const double t = n * 125e-6, wobble = std::sin(1e4 * n * n);
    std::snprintf(row, sizeof row, "%.6f,628.3185,%.4f,0.032,%.3f,0.024,%.3f\n", t,
                  2 + 0.1 * t + 0.1 * wobble, 200 + 10 * wobble, 150 - 10 * wobble);
    cut += row;
  }
  put("cut.csv", cut);
}

/// A trace of the spindle and x; without the spindle's speed where it has to come from the file.
/// A dynamometer in a cut at 200 turns a second.
void put_dyno() {
  std::string dyno = "t_s,spindle.speed_rad_s,dyno.force_x_N,dyno.force_y_N,dyno.force_z_N\n";
  char row[200];
  for (int n = 0; n < 2000; ++n) {
    const double t = n * 125e-6, turn = 1256.637061 * t;
    const double force = 50 + 20 * std::sin(turn) + 9 * std::sin(4 * turn) +
                         2 * std::sin(14 * turn) + std::sin(1e4 * n * n);
    std::snprintf(row, sizeof row, "%.6f,1256.637061,%.4f,%.4f,%.4f\n", t, force, 2 * force,
                  30 - force);
    dyno += row;
  }
  put("dyno.csv", dyno);
}

/// A cut that sensors beside the drives hear: tooth passing, and lines off its orders.
void put_sensors() {
  std::string heard =
      "t_s,spindle.speed_rad_s,spindle.torque_Nm,tool.acceleration_x_m_s2,microphone.sound_Pa\n";
  char row[200];
  for (int n = 0; n < 12000; ++n) {
    const double t = n * 125e-6, angle = 600 * t, noise = std::sin(1e4 * n * n);
    const double whirs = n > 4000 ? std::sin(2 * 3.14159265 * 610 * t) : 0;
    const double teeth = n > 1000 ? std::sin(4 * angle) : 0;
    std::snprintf(row, sizeof row, "%.6f,600,%.4f,%.5f,%.5f\n", t,
                  0.7 + 0.05 * noise + (n > 1000 ? 3 + teeth : 0), 0.1 * noise + teeth + 2 * whirs,
                  0.5 * noise + teeth + 200 * whirs);
    heard += row;
  }
  put("sensors.csv", heard);
}

void put_traces() {
  put_sensors();
  put_dyno();
  std::string fast =
      "t_s,spindle.speed_rad_s,spindle.current_A,tool.acceleration_x_m_s2,x.velocity_m_s,x.current_"
      "A,spindle.load_V,a.speed_rad_s,a.torque_Nm,spindle.torque_percent,spindle.current_percent,"
      "x.torque_percent,x.current_percent,spindle.torque_Nm,x.force_N\n";
  std::string still = "t_s,spindle.current_A\n";
  std::string slow = "t_s,x.velocity_m_s,x.current_A,x.torque_Nm\n";
  std::string load = "t_s,spindle.speed_rad_s,spindle.load_percent\n";
  std::string volts = "t_s,spindle.speed_rad_s,spindle.load_V\n";
  std::string powered = "t_s,spindle.speed_rad_s,spindle.current_A,spindle.power_W\n";
  char row[300];
  for (int n = 0; n < 4000; ++n) {
    const double t = n * 125e-6, wobble = std::sin(40 * t) + 0.01 * std::sin(1e4 * n * n);
    std::snprintf(row, sizeof row,
                  "%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.3f,%.3f,%.3f,%.3f,%.4f,%.4f\n", t,
                  600 + wobble, 1 + 0.2 * wobble, 3 * wobble, 0.1 * std::sin(9 * t), 2 + wobble,
                  0.5, 1 + 0.5 * std::sin(40 * t), 3 + wobble, 50 + wobble, 40 + wobble,
                  30 + wobble, 20 + wobble, 0.5 + 0.12 * wobble, 900 + 200 * wobble);
    fast += row;
    std::snprintf(row, sizeof row, "%.6f,%.6f\n", t, 1 + 0.2 * wobble);
    still += row;
    std::snprintf(row, sizeof row, "%.6f,%.6f,%.6f,%.6f\n", 20 * t, 0.1 * std::sin(3 * t),
                  2 + wobble, 1.5 + wobble);
    slow += row;
    std::snprintf(row, sizeof row, "%.6f,%.6f,%.6f\n", t, 100 * t * (1 + t), 20 + 3 * wobble);
    load += row;
    volts += row;
    std::snprintf(row, sizeof row, "%.6f,%.6f,%.6f,%.6f\n", t, 600 + wobble, 1 + 0.2 * wobble,
                  300 + 60 * wobble);
    powered += row;
  }
  std::string slow_spindle = "t_s,spindle.speed_rad_s,spindle.current_A\n";
  for (int n = 0; n < 4000; ++n) {
    const double t = n * 1e-3;
    std::snprintf(row, sizeof row, "%.6f,600,%.6f\n", t,
                  1 + 0.01 * std::sin(1e4 * n * n) + 0.5 * std::sin(300 * 3.14159265 * t));
    slow_spindle += row;
  }
  put("slow_spindle.csv", slow_spindle);
  put("fast.csv", fast);
  put("still.csv", still);
  put("slow.csv", slow);
  put("load.csv", load);
  put("volts.csv", volts);
  put("powered.csv", powered);
  put_pairs();
  put_cut();
  put("sunk.ngc",
      "G21\nS5000 M3\nG0 Z5\nG0 X5 Y5\nG1 Z0 F100\nG1 X10 Z-3\nG1 X25 Y20\nG0 Z5\nG0 X40\nG0 Z-20\n"
      "G0 Z5\nM2\n");
  put("slot.ngc",
      "G21\nG0 Z5\nG0 X-30 Y20\nG0 Z-22\nG1 X60 F100\nG0 Z5\nG0 Y-19.5\nG0 Z-22\nG1 X-30\nG0 "
      "Z5\nM2\n");
  put("tool.tbl", "T1 P1 Z80 D10\n");
  put("cut.ngc", "G21\nS3000 M3\nG0 X-30 Y20 Z5\nG0 Z-5\nG1 X60 F500\nG1 Y90\nM2\n");
  put("part.ngc", "T1 M6\nS1000 M3\nG0 X10 Y5 Z1\nG1 X20 F600\nM2\n");
  put("motion.csv",
      "t_s,x.position_m,y.position_m\n0,0,0\n0.05,0.001,0.002\n0.1,0.004,0.003\n0.2,0.004,0\n");
  put("c45.ini", "[tool]\ntangential_coefficient_N_per_m2 = 7e8\nradial_ratio = 0.3\n");
  put("c45.ini2", "[tool]\ntangential_coefficient_N_per_m2 = 9e8\nradial_ratio = 0.3\n");
  put("y_receptance.csv",
      "frequency_hz,receptance_re_m_per_N,receptance_im_m_per_N,coherence\n100,1e-8,-1e-10,1\n600,"
      "1e-8,-3e-7,1\n1200,-1e-8,-1e-9,1\n");
  put("y_receptance.csv2",
      "frequency_hz,receptance_re_m_per_N,receptance_im_m_per_N,coherence\n100,1e-8,-1e-10,1\n600,"
      "1e-8,-2e-7,1\n1200,-1e-8,-1e-9,1\n");
}

/// What a command makes of the file `m.ini`, its own name and the time aside.
std::string outcome(const std::string& command) {
  std::error_code gone;
  fs::remove(folder / "made.csv", gone);
  const Outcome o = run(command);
  return std::to_string(o.status) + o.out + o.err + content(folder / "made.csv");
}

const std::string kMilling = "simulate milling --machine m.ini --out made.csv --json";
const std::string kLobes = "lobes --machine m.ini --speeds 10 --json";
const std::string kWarm = "simulate drive --machine m.ini --motion warm.txt --out made.csv --json";
const std::string kDrive =
    "simulate drive --machine m.ini --motion motion.csv --out made.csv --json";
const std::string kFast = "monitor --machine m.ini --trace fast.csv --json";
const std::string kStill = "monitor --machine m.ini --trace still.csv --json";
const std::string kLoad = "monitor --machine m.ini --trace load.csv --json";
const std::string kVolts = "monitor --machine m.ini --trace volts.csv --json";
const std::string kPowered = "monitor --machine m.ini --trace powered.csv --json";
const std::string kSlow = "monitor --machine m.ini --trace slow.csv --json";

const std::string kSides = "monitor --machine m.ini --trace sides.csv --json";
const std::string kY = "monitor --machine m.ini --trace y.csv --json";
const std::string kTold = "monitor --machine m.ini --trace told.csv --json";
const std::string kSlowSpindle = "monitor --machine m.ini --trace slow_spindle.csv --json";

const std::string kPredict =
    "program predict slot.ngc --machine m.ini --stock box:0,0,-0.03,0.03,0.04,0 --tolerance 1e-3 "
    "--json";
const std::string kCheck =
    "program check sunk.ngc --machine m.ini --stock box:0,0,-0.03,0.03,0.04,0 --tolerance 1e-3 "
    "--json";
const std::string kMeasured =
    "program check sunk.ngc --machine m.ini --stock box:0,0,-0.03,0.03,0.04,0 --tolerance 1e-3 "
    "--tools tool.tbl --json";
const std::string kSteps =
    "program predict cut.ngc --machine m.ini --stock box:0,0,-0.03,0.03,0.04,0 --tolerance 1e-3 "
    "--out made.csv --quiet --json";
const std::string kFeeds =
    "program optimise cut.ngc --machine m.ini --stock box:0,0,-0.03,0.03,0.04,0 --tolerance 1e-3 "
    "--out made.csv --quiet --json";
const std::string kRecommend = "recommend --machine m.ini --quiet --json";
const std::string kProgram = "program motion part.ngc --machine m.ini --out made.csv --json";
const std::string kDyno =
    "compensate dynamometer --machine m.ini --trace dyno.csv --out made.csv --json";
// Without an alarm: how long a CNC takes to answer differs from run to run.
const std::string kOverride = "monitor --machine m.ini --trace fast.csv --cnc simulated --json";
const std::string kSensors = "monitor --machine m.ini --trace sensors.csv --json";
const std::string kCut = "monitor --machine m.ini --trace cut.csv --json";

bool is_motion_limit(const Line& l) {
  return every_key::any_of(l.key, {"tool_change_s", "spindle_start_s", "waits_for_spindle",
                                   "max_acceleration_m_s2", "max_jerk_m_s3"});
}

/// The commands that could know the section, the cheapest first.
std::vector<std::string> commands_for(const Line& l) {
  const std::string& s = l.section;
  if (l.key == "seed") return {kDrive};
  if (is_motion_limit(l)) return {kProgram};
  if (s.starts_with("dynamometer")) return {kDyno};
  if (s == "override") return {kOverride};
  if (every_key::is_sensor(l)) return {kSensors};
  if (l.key == "effort_share_error") return {kFast, kY};
  if (l.key == "effort_noise_W") return {kPowered};
  if (every_key::any_of(l.key, {"torque_constant_per_K", "torque_constant_at_C"})) return {kWarm};
  if (s.starts_with("monitor.signal.")) return {l.key.starts_with("skew_") ? kSides : kTold};
  if (every_key::any_of(l.key, {"line_threshold_Nm2", "own_lines_hz"})) return {kSlowSpindle};
  if (s == "monitor.cutting-coefficients" || l.key == "specific_force_ratio") return {kCut};
  if (every_key::is_cutter_shape(l)) return {kPredict};
  if (l.section == "tool" && l.key == "length_m") return {kMeasured};
  if (every_key::any_of(l.key, {"torque_Nm", "power_W", "deflection_m", "cutting_speed_m_s",
                                "tangential_coefficient_relative_error", "modes_relative_error"}))
    return {kRecommend};
  if (every_key::is_program_limit(l)) return {kCheck};
  if (every_key::is_torque_law(l)) return {kSteps};
  if (every_key::is_feed_limit(l)) return {kFeeds};
  if (s == "tool" || s == "cut" || s == "simulation" || s.starts_with("structure.") ||
      s.starts_with("effect.tool."))
    return {kMilling + " --ideal-drives", kLobes, kMilling};
  if (s.starts_with("controller."))
    return {s == "controller.spindle" ? kMilling : kDrive, kMilling};
  if (s.starts_with("effect.spindle.")) return {kMilling};
  if (s.starts_with("effect.")) return {kDrive, kMilling};
  return {kFast, kStill, kSlow, kLoad, kVolts, kDrive, kMilling};
}

/// The value of complete.ini, or one at which the key decides something.
std::string deciding(const Line& l) {
  if (l.key == "max_speed_rpm") return "6000";                 // the trace has 5730
  if (l.key == "max_velocity_m_s") return "0.1";               // as fast as it goes
  if (l.key == "rated_power_W") return "0.05";                 // less than any chatter takes
  if (l.key == "torque_constant_known_to_rpm") return "3000";  // likewise
  if (l.key == "surface_points") return "600";                 // fewer than the steps of a turn
  if (l.key == "duration_s") return "0.07";
  if (l.key == "accelerating_rad_s2") return "21";  // the trace has 20
  if (every_key::is_sensor(l) && l.key == "tolerated_load_share")
    return "0.65";  // the line has less
  return l.value;
}

/// The file in which this key has this value, and whatever gives it a meaning.
std::string file_with(const Line& l, const std::string& value) {
  MachineFile file = *MachineFile::parse(std::string(kMachine) + kControllers + kMonitors, "m.ini");
  for (const Line& other : every_key::all_keys())  // with the rest of its section
    if (l.section.starts_with("effect.") && other.section == l.section && other.key != l.key)
      file.set(other.section, other.key, other.value);
  if (l.key == "current_is_ratio") file.set(l.section, "effort_column", "tool.acceleration_x_m_s2");
  const std::string channel = l.section.substr(l.section.find('.') + 1);
  if (l.key == "rated_torque_Nm") file.set(l.section, "effort_column", channel + ".torque_percent");
  if (l.key == "rated_current_A")
    file.set(l.section, "effort_column", channel + ".current_percent");
  if (l.key.starts_with("effort_noise_"))
    for (const char* key :
         {"effort_noise_A", "effort_noise_Nm", "effort_noise_N", "effort_noise_W"})
      if (servosense::find_machine_key(l.section, key) != nullptr) file.set(l.section, key, 0.1);
  if (l.section == "spindle") file.set(l.section, "rated_torque_Nm", 24);
  if (l.section != "limits" && (l.key.starts_with("power_") || l.key.starts_with("copper_"))) {
    file.set(l.section, "load_percent_of", "power");
    file.set(l.section, "rated_power_W", 5500);
  }
  if (l.key == "torque_constant_at_C") file.set(l.section, "torque_constant_per_K", -0.001);
  if (l.key == "effort_noise_W") file.set(l.section, "power_known_from_rpm", 50);
  if (l.key == "tooth_breaks") file.set("simulation", "start", "immersed");
  if (l.key == "frf") file.remove(l.section, "modes");
  if (l.key == "coefficients") {
    file.remove("tool", "tangential_coefficient_N_per_m2");
    file.remove("tool", "radial_ratio");
  }
  if (every_key::is_cutter_shape(l)) {
    const char* kind = l.key == "point_angle_deg"      ? "drill"
                       : l.key == "taper_deg"          ? "taper"
                       : l.key == "entering_angle_deg" ? "face"
                                                       : "bull";
    file.set("tool", "kind", kind);
    file.set("tool", "corner_radius_m", *kind == 'b' ? 0.001 : 0.0);
    file.set("tool", "flute_length_m", 0.02);
    file.set("tool", "stick_out_m", 0.021);
    file.set("tool", "holder_diameter_m", 0.05);
  }
  if (l.key == "torque_equation_relative_error")
    file.set("tool", "torque_equation", "1.39 0.36 0.00316");
  if (every_key::is_feed_limit(l)) file.set("limits", "feed_per_tooth_m", 0.004);
  if (l.key == "feed_m_s")
    for (const char* axis : {"axis.x", "axis.y", "axis.z"}) file.set(axis, "max_velocity_m_s", 1.0);
  if (l.key == "fraction") file.remove(l.section, "shorter_m");  // the same, said as a length
  if (l.key == "seed") file.set("controller.x", "current_noise_A", 0.02);
  if (l.key == "slow_signal" || (l.key == "effort_noise_Nm" && l.section == "axis.x"))
    file.set("machine", "sample_rate_hz", 400);
  if (!every_key::is_sensor(l) &&
      every_key::any_of(l.key, {"line_threshold_Nm2", "own_lines_hz"})) {
    file.set("machine", "sample_rate_hz", 1000);
    file.set(l.section, "line_threshold_Nm2", 0.01);
    file.remove(l.section, "chatter_threshold_Nm2");
    file.remove(l.section, "forced_threshold_Nm2");
  }
  if (l.section == "monitor.collision.a") {
    file.set("axis.a", "inertia_kg_m2", 2);
    file.set(l.section, "threshold_Nm_per_s", 500);
    file.set(l.section, "phase_thresholds_Nm_per_s", "100, 300, 500, 500");
    file.set(l.section, "maximum_feed_rad_s", 0.1);  // no cut, whatever the spindle does
  }
  if (l.section == "monitor.cutting-coefficients" || l.key == "specific_force_ratio") {
    file.set("monitor.collision", "cutting_torque_Nm", 0.3);
    if (l.key != "enabled") file.set("monitor.cutting-coefficients", "enabled", true);
  }
  if (l.key == "follow_friction_share") file.set("monitor.collision", "cutting_torque_Nm", 0.2);
  if (l.key == "effort_share_error") file.set(l.section, "effort_share", 0.6);
  if (every_key::is_sensor(l)) {
    file.set("monitor.collision", "cutting_torque_Nm", 1);
    for (const Line& other : every_key::all_keys())
      if (other.section == l.section && other.key != l.key && other.key != "own_lines_hz")
        file.set(other.section, other.key, other.value);
    // What lines alone decide.
    if (every_key::any_of(l.key, {"own_lines_hz", "tolerated_load_share"}))
      file.set(l.section, "chatter_threshold_m2_s4", 1e6);
  }
  if (l.section.starts_with("monitor.signal.")) {
    file.set("machine", "sample_rate_hz", 2000);
    if (l.key.starts_with("skew_")) file.set("axis.x", "gantry", true);
    for (const Line& other : every_key::all_keys())
      if (other.section == l.section && other.key != l.key)
        file.set(other.section, other.key, other.value);
    file.set("axis.a", "inertia_kg_m2", 2);
    file.set("axis.a", "encoder_counts_per_rev", 6.2831853e6);
  }
  if (is_motion_limit(l))
    for (const char* axis : {"axis.x", "axis.y", "axis.z"})
      file.set(axis, "max_acceleration_m_s2", 2);
  if (l.key == "spindle_start_s") file.set(l.section, "waits_for_spindle", true);
  if (l.key == "waits_for_spindle") file.set(l.section, "spindle_start_s", 3);
  if (l.key == "workpiece") file.set("simulation", "start", "entry");
  if (l.section == "override")
    for (const Line& other : every_key::all_keys())
      if (other.section == l.section && other.key != l.key)
        file.set(other.section, other.key, other.value);
  if (l.section == "dynamometer") file.set("dynamometer.x", "modes", "930 0.03 0.8");
  if (l.key == "modes_relative_error") file.set(l.section, "modes", "600 0.03 12, 910.5 0.02 7");
  file.set(l.section, l.key, value);
  return file.text();
}

void every_key_shows() {
  put("warm.txt",
      "spindle limits 100 400 20000\nspindle temperature 80 80 1\nspindle cruise 100 0.5\n"
      "x limits 0.1 1 50\nx temperature 80 80 1\nx move 0.02\n");
  int shown = 0, records = 0;
  for (const Line& l : every_key::all_keys()) {
    if (!every_key::is_host_only(l)) continue;
    if (is_a_record(l) || is_named_only(l)) {
      ++records;
      continue;
    }
    const servosense::MachineKey* const key = servosense::find_machine_key(l.section, l.key);
    CHECK(key != nullptr);
    if (key == nullptr) continue;
    const std::string value = deciding(l);
    bool differs = false;
    for (const std::string& command : commands_for(l)) {
      put("m.ini", file_with(l, value));
      const std::string before = outcome(command);
      put("m.ini", file_with(l, every_key::changed(*key, value)));
      differs = before != outcome(command);
      if (differs) break;
    }
    if (!differs) std::printf("    [%s] %s changes nothing\n", l.section.c_str(), l.key.c_str());
    CHECK(differs);
    ++shown;
  }
  check::figure("keys that only hosts use, each shown by a command", shown);
  check::figure("records for people, and effects that reconcile alone knows", records);
}

/// What means nothing where it stands.
void meaningless(const std::string& line, const std::string& section, const std::string& says) {
  put("m.ini", "[" + section + "]\n" + line + "\n");
  const Outcome o = run("monitor --machine m.ini --trace fast.csv");
  if (o.status != 3 || !contains(o.err, says))
    std::printf("    %s: %s\n", line.c_str(), o.err.c_str());
  CHECK(o.status == 3 && contains(o.err, says) && contains(o.err, "m.ini:"));
}

void what_means_nothing_is_refused() {
  meaningless("channel = spindle", "monitor.chatter", "unknown key 'channel'");
  meaningless("consecutive_samples = 3", "monitor.chatter", "unknown key 'consecutive_samples'");
  meaningless("consecutive_samples = 8589934594", "monitor.collision",
              "'consecutive_samples': expected");
  meaningless("warning_fraction = 0.5", "monitor.signal", "unknown key 'warning_fraction'");
  meaningless("cutoff_rad_s = 300", "monitor.wear", "unknown key 'cutoff_rad_s'");
  meaningless("notch_hz = 500, 1000, 2000", "monitor.collision", "expected 1 to 2 numbers");
  meaningless("phase_thresholds_x_N_per_s = 1e4, 2e4", "monitor.collision", "expected 4 numbers");
  meaningless("name = \x1b[31mred", "machine", "UTF-8");
  meaningless("name = Fr\xE4se", "machine", "UTF-8");
}

/// Of a file that serves others, too.
void what_is_not_used_is_said() {
  put("m.ini", std::string(kMachine) + "[effect.tool.runout]\nthrow_m = 5e-6\nangle_rad = 1\n");
  CHECK(contains(run(kFast).out, "[effect.tool.runout] is not used"));
  put("m.ini", std::string(kMachine) +
                   "[effect.x.spring-load]\nstiffness_N_per_m = 5\nrest_position_m = 0\n");
  CHECK(!contains(run(kFast).out, "is not used"));
}

}  // namespace

int main() {
  return in_own_folder("every_key", [] {
    put_traces();
    every_key_shows();
    what_means_nothing_is_refused();
    what_is_not_used_is_said();
  });
}
