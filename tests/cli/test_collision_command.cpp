// A good part teaches what the axes do in the cut, then parts run sound and into a clamp: identify
// collision and monitor as a user meets them. And a drive whose columns have other names.
#include <cmath>
#include <cstdio>
#include <random>
#include <sstream>
#include <string>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

constexpr double kRate_hz = 1000, kPi = 3.14159265358979;

const char* const kDrives =
    "[machine]\nname = test bed\n\n[spindle]\ntorque_constant_Nm_per_A = 0.5\n"
    "inertia_kg_m2 = 0.01\nviscous_friction_Nm_s_per_rad = 0.002\ncoulomb_friction_Nm = 0.3\n\n"
    "[axis.x]\nequivalent_mass_kg = 150\nviscous_friction_N_s_per_m = 500\n"
    "coulomb_friction_N = 60\n\n";
const char* const kIdle = "[monitor.collision]\nthreshold_x_N_per_s = 3000\n";
const char* const kTorque = "cutting_torque_Nm = 0.3\n";

struct Part {
  unsigned seed = 1;
  double load = 1;        ///< of the usual cut; 0 = air
  double clamp_s = 1e9;   ///< x runs into something...
  double clamp_N = 2000;  ///< ...that gives way at this force...
  double rate = 200e3;    ///< ...and takes it up at this rate [N/s]
};

// 2400 rpm, two teeth, from 1 s to 4 s: 3 Nm and 300 N, both with the teeth in them.
void record(const std::string& name, const Part& part) {
  std::mt19937 random(part.seed);
  std::normal_distribution<double> noise;
  const double speed = 2400 * 2 * kPi / 60, feed = 0.02;
  std::string text = "t_s,spindle.angle_rad,spindle.torque_Nm,x.position_m,x.force_N\n";
  for (int n = 0; n < 5 * static_cast<int>(kRate_hz); ++n) {
    const double t = n / kRate_hz, angle = speed * t;
    const double on = std::fmax(0, std::fmin(1, std::fmin((t - 1) / 0.1, (4 - t) / 0.1)));
    const double teeth = part.load * on * (1 + 0.5 * std::sin(2 * angle));
    const double past = (t - part.clamp_s) * part.rate;
    const double clamp = past > 0 && past < part.clamp_N ? past : 0;
    const double torque = 3 * teeth + 0.002 * speed + 0.3 + 0.02 * noise(random);
    const double force = 300 * teeth + clamp + 500 * feed + 60 + 2 * noise(random);
    char line[120];
    std::snprintf(line, sizeof line, "%.3f,%.9f,%.6g,%.9f,%.6g\n", t, angle, torque, feed * t,
                  force);
    text += line;
  }
  put(name, text);
}

// The same part, with the columns of time and x alone.
void leave_out_spindle(const std::string& from, const std::string& to) {
  std::istringstream in(content(folder / from));
  std::string text;
  for (std::string line; std::getline(in, line);) {
    const std::size_t first = line.find(',');
    const std::size_t third = line.find(',', line.find(',', first + 1) + 1);
    text += line.substr(0, first) + line.substr(third) + '\n';
  }
  put(to, text);
}

double alarm_s(const std::string& events) {
  const std::size_t alarm = events.find("\"state\": \"alarm\"");
  if (alarm == std::string::npos) return -1;
  const std::size_t line = events.rfind('\n', alarm) + 1;
  return std::atof(events.c_str() + events.find("\"t_s\": ", line) + 7);
}

Outcome watch(const std::string& machine, const Part& part) {
  record("part.csv", part);
  return run("monitor --machine " + machine +
             " --trace part.csv --events events.jsonl --quiet --fail-on-alarm");
}

void taught_and_watched() {
  put("machine.ini", std::string(kDrives) + kIdle + kTorque);
  record("good.csv", {.seed = 1});
  record("deeper.csv", {.seed = 2, .load = 1.1});
  const Outcome taught =
      run("identify collision --machine machine.ini --out taught.ini --quiet good.csv deeper.csv");
  that(taught.status == 0 && taught.err.empty(), taught, "is taught", __LINE__);
  that(contains(taught.out, "in 2 part(s)") &&
           contains(content(folder / "taught.ini"), "cutting_threshold_x_N_per_s = "),
       taught, "says and writes it", __LINE__);
  const Outcome json =
      run("identify collision --machine machine.ini --out taught.ini --quiet --json good.csv "
          "deeper.csv");
  const Json read(json.out);
  // Three seconds of cut each, less the delay of the torque and its hold.
  that(read.ok && std::abs(read.number("cutting_s") - 6) < 0.5, json, "JSON", __LINE__);
  // Tooth passing at 80 Hz, 165 N, through observer and jerk filter at 335 rad/s each, and twice.
  const double w = 2 * kPi * 80;
  const double teeth = 165 * w / std::pow(1 + std::pow(w / 335, 2), 1.5);
  const double learned = read.number("axes.0.cutting_threshold_N_per_s");
  that(learned > 1.6 * teeth && learned < 2.4 * teeth, json, "twice what the teeth do", __LINE__);

  // What the idling run taught is no use in the cut: there it is unarmed and says what to do. In
  // the air it is armed.
  const Outcome idle = watch("machine.ini", {.seed = 3});
  that(idle.status == 0 && contains(idle.out,
                                    "in the cut it is unarmed until 'servosense identify "
                                    "collision'"),
       idle, "a sound part, untaught", __LINE__);
  const Outcome in_air = watch("machine.ini", {.seed = 4, .clamp_s = 0.5});
  that(in_air.status == 1, in_air, "into a clamp in the air, untaught", __LINE__);
  const Outcome sound = watch("taught.ini", {.seed = 3, .load = 1.05});
  that(sound.status == 0 && contains(sound.out, ", in the cut beyond"), sound, "a sound part",
       __LINE__);
  for (const double at_s : {0.5, 2.5}) {
    const Outcome crash = watch("taught.ini", {.seed = 4, .clamp_s = at_s});
    const double found_s = alarm_s(content(folder / "events.jsonl"));
    that(crash.status == 1 && found_s > at_s && found_s < at_s + 0.02, crash, "into a clamp",
         __LINE__);
  }
  // A light touch in the air: nothing that a cut could not do, but no torque follows.
  const Outcome light =
      watch("taught.ini", {.seed = 5, .clamp_s = 0.5, .clamp_N = 300, .rate = 2e4});
  const double found_s = alarm_s(content(folder / "events.jsonl"));
  that(light.status == 1 && found_s > 0.53 && found_s < 0.56, light, "after the wait", __LINE__);
}

void refusals() {
  put("plain.ini", std::string(kDrives) + kIdle);
  put("machine.ini", std::string(kDrives) + kIdle + kTorque);
  record("air.csv", {.load = 0});
  refused("identify collision --machine machine.ini --out x.ini", 2, {"one trace or more"},
          __LINE__);
  refused("identify collision --machine machine.ini --out x.ini air.csv", 3,
          {"air.csv", "shows no cut"}, __LINE__);
  refused("identify collision --machine plain.ini --out x.ini air.csv", 3,
          {"plain.ini", "cutting_torque_Nm", "identify idle"}, __LINE__);
  // Without the torque that means cutting, the tool may cut wherever the spindle turns.
  record("part.csv", {});
  const Outcome plain = run("monitor --machine plain.ini --trace part.csv --fail-on-alarm");
  that(plain.status == 0 &&
           contains(plain.out,
                    "below 12 m/min with the spindle turning it is "
                    "unarmed") &&
           contains(plain.out, "learns cutting_torque_Nm"),
       plain, "says what lacks", __LINE__);
  put("half.ini", std::string(kDrives) + kIdle + "cutting_threshold_x_N_per_s = 9e4\n");
  const Outcome half = run("monitor --machine half.ini --trace part.csv --fail-on-alarm");
  that(half.status == 0 && contains(half.out, ", below 12 m/min with the spindle turning beyond"),
       half, "says where it holds", __LINE__);
  // And wherever the axis is slow enough, when there is a spindle and nothing is heard of it.
  leave_out_spindle("part.csv", "axis.csv");
  const Outcome axis = run("monitor --machine machine.ini --trace axis.csv --fail-on-alarm");
  that(axis.status == 0 && contains(axis.out, "below 12 m/min it is unarmed") &&
           contains(axis.out, "record the spindle's motion"),
       axis, "without the spindle", __LINE__);
}

// A microphone in place of the torque, and a spindle whose speed nobody recorded.
void columns_by_name() {
  std::string text = "t_s,tool.acceleration_x_m_s2\n";
  for (int n = 0; n < 2000; ++n) {
    char line[64];
    std::snprintf(line, sizeof line, "%.3f,%.6g\n", n / 1000.0, std::sin(0.3 * n));
    text += line;
  }
  put("sound.csv", text);
  put("sound.ini",
      "[machine]\nname = mill\n[spindle]\neffort_column = tool.acceleration_x_m_s2\n"
      "constant_speed_rpm = 6000\n");
  const Outcome heard =
      run("monitor --machine sound.ini --trace sound.csv --estimates out.csv --quiet");
  that(heard.status == 0, heard, "runs", __LINE__);
  that(contains(content(folder / "out.csv"), "spindle.torque_Nm"), heard, "estimates", __LINE__);
  put("wrong.ini",
      "[machine]\nname = mill\n[spindle]\neffort_column = tool.acceleration_y_m_s2\n"
      "constant_speed_rpm = 6000\n");
  refused("monitor --machine wrong.ini --trace sound.csv", 3,
          {"sound.csv", "tool.acceleration_y_m_s2", "effort_column"}, __LINE__);
  // At 100 Hz the collision monitor runs when told to, and says how late it is.
  text = "t_s,x.position_m,x.force_N\n";
  for (int n = 0; n < 200; ++n) {
    char line[64];
    std::snprintf(line, sizeof line, "%.2f,%.6g,%.6g\n", n / 100.0, 1e-4 * n, 70.0);
    text += line;
  }
  put("slow.csv", text);
  put("fast.ini", std::string(kDrives) + kIdle);
  put("slow.ini", std::string(kDrives) + kIdle + "slow_signal = yes\n");
  const Outcome fast = run("monitor --machine fast.ini --trace slow.csv");
  that(contains(fast.out, "needs at least 500 Hz") && contains(fast.out, "slow_signal"), fast,
       "refused", __LINE__);
  const Outcome slow = run("monitor --machine slow.ini --trace slow.csv");
  that(slow.status == 0 && contains(slow.out, "which takes 30 ms after some 20 ms"), slow, "waived",
       __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("collision", [] {
    taught_and_watched();
    refusals();
    columns_by_name();
  });
}
