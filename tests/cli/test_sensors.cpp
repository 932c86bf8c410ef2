// Accelerometer and microphone beside the drives, as a user has them: an idling run teaches,
// chatter in a cut is heard and said by whom, and what keeps a sensor from hearing is said, too.
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <functional>
#include <random>
#include <string>

#include "cli/program.hpp"
#include "servosense/core/units.hpp"

using namespace program_test;
using servosense::kTwoPi;

namespace {

constexpr double kPeriod_s = 1.0 / 8000, kInertia = 5e-3, kViscous = 2e-3, kCoulomb = 0.3;

struct Record {
  bool cuts = false, chatters = false;
  const char* accelerometer = "accelerometer.acceleration_m_s2";
  double per_unit = 1;  // m/s2 of its column
  bool microphone = true;
};

/// A spindle that goes to two speeds, and in a cut stays at the second: teeth, two fans, noise.
void write(const std::string& name, const Record& r) {
  std::mt19937_64 bits(5);
  std::normal_distribution<double> gauss;
  std::ofstream out(folder / name);
  out << "t_s,spindle.angle_rad,spindle.torque_Nm";
  if (r.accelerometer != nullptr) out << ',' << r.accelerometer;
  if (r.microphone) out << ",microphone.sound_Pa";
  out << '\n';
  const double slow = 180, fast = 329.3, ramp = 1500;
  double speed = 0, angle = 0;
  const auto count = static_cast<std::size_t>((r.cuts ? 4.0 : 9.0) / kPeriod_s);
  for (std::size_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) * kPeriod_s;
    double target = fast;
    if (!r.cuts) target = t < 0.5 ? 0 : t < 4 ? slow : t < 8 ? fast : 0;
    const double step = ramp * kPeriod_s;
    const double was = speed;
    speed += std::min(step, std::max(-step, target - speed));
    angle += (was + speed) / 2 * kPeriod_s;
    double torque = kInertia * (speed - was) / kPeriod_s + kViscous * speed +
                    (speed > 0 ? kCoulomb : 0) + 0.02 * gauss(bits);
    double acceleration =
        0.4 * gauss(bits) + 0.5 * std::cos(angle) + 2 * std::cos(kTwoPi * 610 * t);
    double sound =
        0.02 * gauss(bits) + 0.1 * std::cos(kTwoPi * 50 * t) + 0.05 * std::cos(kTwoPi * 1111 * t);
    if (r.cuts && t > 1) {
      torque += 3 + std::cos(4 * angle);
      acceleration += 6 * std::cos(4 * angle) + 2 * std::cos(8 * angle);
      sound += 0.3 * std::cos(4 * angle + 1);
    }
    if (r.chatters && t > 2.5) {
      acceleration += 5 * std::cos(kTwoPi * 863.2 * t);
      sound += 0.2 * std::cos(kTwoPi * 863.2 * t);
    }
    char line[200];
    int n = std::snprintf(line, sizeof line, "%.6f,%.8f,%.5f", t, angle, torque);
    if (r.accelerometer != nullptr)
      n += std::snprintf(line + n, sizeof line - static_cast<std::size_t>(n), ",%.6g",
                         acceleration / r.per_unit);
    if (r.microphone)
      n += std::snprintf(line + n, sizeof line - static_cast<std::size_t>(n), ",%.6g", sound);
    out << line << '\n';
  }
}

std::size_t size_of(const Json& json, const std::string& path) {
  const auto found = json.sizes.find(path);
  return found == json.sizes.end() ? 0 : found->second;
}

/// The event of a channel that is the first alarm; its index, or -1.
int alarm_of(const Json& json, const std::string& channel) {
  for (std::size_t i = 0; i < size_of(json, "events"); ++i) {
    const std::string event = "events." + std::to_string(i);
    if (json.text(event + ".state") == "alarm" && json.text(event + ".channel") == channel &&
        json.text(event + ".monitor") == "chatter")
      return static_cast<int>(i);
  }
  return -1;
}

/// The monitor of a channel: "true", "false" or "(absent)", and its reason.
std::pair<std::string, std::string> runs(const Json& json, const std::string& channel) {
  for (std::size_t i = 0; i < size_of(json, "monitors"); ++i) {
    const std::string monitor = "monitors." + std::to_string(i);
    if (json.text(monitor + ".name") == "chatter" && json.text(monitor + ".channel") == channel)
      return {json.text(monitor + ".runs"), json.text(monitor + ".reason")};
  }
  return {"(absent)", ""};
}

void learned_and_heard() {
  put("m.ini", "[machine]\nsample_rate_hz = 8000\n[spindle]\n[tool]\nteeth = 4\n");
  write("idle.csv", {});
  const Outcome idle = run("identify idle --machine m.ini --trace idle.csv --out m2.ini --json");
  const Json learned(idle.out);
  that(idle.status == 0 && learned.ok, idle, "learns", __LINE__);
  that(learned.text("sensors.0.channel") == "accelerometer" &&
           learned.text("sensors.1.channel") == "microphone",
       idle, "both sensors", __LINE__);
  CHECK(size_of(learned, "sensors.0.own_lines") == 1);
  CHECK_NEAR(learned.number("sensors.0.own_lines.0.frequency_hz"), 610, 1);
  CHECK_NEAR(learned.number("sensors.0.own_lines.0.amplitude"), 2, 0.2);
  CHECK(size_of(learned, "sensors.1.own_lines") == 2);
  CHECK_BETWEEN(learned.number("sensors.0.noise"), 0.35, 0.6);
  that(contains(content(folder / "m2.ini"), "[monitor.chatter.accelerometer]"), idle, "a section",
       __LINE__);

  Record cut{true, true};
  write("cut.csv", cut);
  const Outcome o = run("monitor --machine m2.ini --trace cut.csv --json");
  const Json json(o.out);
  that(o.status == 0 && json.ok, o, "watches", __LINE__);
  for (const char* channel : {"accelerometer", "microphone"}) {
    const int i = alarm_of(json, channel);
    that(i >= 0, o, std::string("an alarm of the ") + channel, __LINE__);
    if (i < 0) continue;
    const std::string event = "events." + std::to_string(i);
    CHECK_BETWEEN(json.number(event + ".t_s"), 2.5, 3.1);
    if (json.text(event + ".unit") == "1")
      CHECK_NEAR(json.number(event + ".frequency_hz"), 863.2, 2);
  }
  // In mm/s2, and said so, the same to the sample.
  cut.per_unit = 1e-3;
  write("cut_mm.csv", cut);
  std::string in_mm = content(folder / "m2.ini");
  in_mm.replace(in_mm.find("[monitor.chatter.accelerometer]\n"), 32,
                "[monitor.chatter.accelerometer]\nm_s2_per_unit = 0.001\n");
  put("mm.ini", in_mm);
  const Outcome mm = run("monitor --machine mm.ini --trace cut_mm.csv --json");
  const Json as_well(mm.out);
  const int i = alarm_of(as_well, "accelerometer"), j = alarm_of(json, "accelerometer");
  that(i >= 0, mm, "an alarm in mm/s2", __LINE__);
  if (i >= 0 && j >= 0)
    CHECK_NEAR(as_well.number("events." + std::to_string(i) + ".t_s"),
               json.number("events." + std::to_string(j) + ".t_s"), 1e-9);

  write("sound.csv", {true, false});
  const Outcome sound = run("monitor --machine m2.ini --trace sound.csv --json");
  const Json quiet(sound.out);
  that(alarm_of(quiet, "accelerometer") < 0 && alarm_of(quiet, "microphone") < 0, sound,
       "none without chatter", __LINE__);
  that(runs(quiet, "microphone").first == "true", sound, "it runs", __LINE__);
}

void what_keeps_it() {
  const auto said = [](const std::string& machine, const std::string& trace,
                       const std::string& channel, const std::string& part, int line) {
    const Outcome o = run("monitor --machine " + machine + " --trace " + trace + " --json");
    const auto [does, reason] = runs(Json(o.out), channel);
    that(does == "false" && contains(reason, part), o, channel + ": '" + part + "', not " + reason,
         line);
  };
  said("m.ini", "cut.csv", "accelerometer", "run 'servosense identify idle'", __LINE__);
  write("deaf.csv", {true, false, nullptr, 1, true});
  said("m2.ini", "deaf.csv", "accelerometer", "no column accelerometer.acceleration_m_s2",
       __LINE__);
  std::string text = content(folder / "m2.ini");
  text.replace(text.find("[monitor.chatter.microphone]\n"), 29,
               "[monitor.chatter.microphone]\nenabled = no\n");
  put("off.ini", text);
  said("off.ini", "cut.csv", "microphone", "switched off", __LINE__);
  // Another column than the usual one.
  write("table.csv", {true, true, "tool.acceleration_x_m_s2", 1, false});
  text = content(folder / "m2.ini");
  text.replace(text.find("[monitor.chatter.accelerometer]\n"), 32,
               "[monitor.chatter.accelerometer]\ncolumn = tool.acceleration_x_m_s2\n");
  put("table.ini", text);
  const Outcome o = run("monitor --machine table.ini --trace table.csv --json");
  that(alarm_of(Json(o.out), "accelerometer") >= 0, o, "an alarm of the named column", __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("sensors", [] {
    learned_and_heard();
    what_keeps_it();
  });
}
