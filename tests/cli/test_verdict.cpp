// What `monitor` says of itself: what watched, what did not and why; a gate fails closed.
#include <cmath>
#include <random>
#include <string>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

constexpr double kRate_hz = 2000;

// Spindle and x, each with noise of its own; nothing happens.
struct Recording {
  unsigned seed = 1;
  double rpm = 3000;
  double turns_from_s = 0, turns_to_s = 1e9;  ///< the spindle stands else
  double dead_from_s = 1e9;                   ///< the spindle's torque is invalid from then on
  double frozen_from_s = 1e9;                 ///< the force of x repeats itself from then on
  bool spindle = true, x = true;
  std::string more;  ///< further columns, all 1
  double seconds = 3;
};

void record(const std::string& name, const Recording& r) {
  std::mt19937 random(r.seed);
  std::normal_distribution<double> noise(0, 1);
  std::string text = "t_s";
  if (r.spindle) text += ",spindle.angle_rad,spindle.torque_Nm";
  if (r.x) text += ",x.position_m,x.force_N";
  text += (r.more.empty() ? "" : "," + r.more) + "\n";
  double angle = 0, force = 0;
  for (int n = 0; n < r.seconds * kRate_hz; ++n) {
    const double t = n / kRate_hz;
    if (t >= r.turns_from_s && t < r.turns_to_s) angle += r.rpm * 2 * M_PI / 60 / kRate_hz;
    const double torque = 0.01 * noise(random);
    if (t < r.frozen_from_s) force = 10 * noise(random);
    char part[120];
    std::snprintf(part, sizeof part, "%.6f", t);
    text += part;
    if (r.spindle) {
      if (t >= r.dead_from_s)
        std::snprintf(part, sizeof part, ",%.9g,nan", angle);
      else
        std::snprintf(part, sizeof part, ",%.9g,%.6g", angle, torque);
      text += part;
    }
    if (r.x) {
      std::snprintf(part, sizeof part, ",%.9g,%.6g", 0.1 + 0.05 * std::sin(2 * t), force);
      text += part;
    }
    if (!r.more.empty()) text += ",1";
    text += "\n";
  }
  put(name, text);
}

const std::string kHead = "[machine]\nname = test bed\nsample_rate_hz = 2000\n\n";
const std::string kSpindle = "[spindle]\ninertia_kg_m2 = 0.001\n\n";
const std::string kX = "[axis.x]\nlead_m = 0.01\nequivalent_mass_kg = 100\n\n";
const std::string kChatter = "[monitor.chatter]\nchatter_threshold_Nm2 = 1\n\n";
const std::string kCollision = "[monitor.collision]\nthreshold_N_per_s = 1e6\n\n";

struct Case {
  const char* name;
  std::string machine;
  Recording trace;
  const char* verdict;
  int status;        ///< with --fail-on-alarm
  std::string says;  ///< in the opening sentence
};

void verdicts() {
  const std::string all = kHead + kSpindle + kX + kChatter + kCollision;
  Recording sound, standing, slow, dead, briefly, frozen, no_x, c_axis, second, fast;
  standing.turns_to_s = 0;
  slow.rpm = 300;
  fast.rpm = 24000;
  dead.dead_from_s = 1;
  briefly.turns_from_s = 2.5;
  frozen.frozen_from_s = 0.5;
  no_x.x = false;
  c_axis.more = "c.angle_rad";
  second.more = "spindle2.load_percent";
  Recording nothing = no_x;
  nothing.dead_from_s = 0;
  Recording only_standing = no_x;
  only_standing.turns_to_s = 0;
  const std::vector<Case> cases = {
      {"everything", all, sound, "clear", 0, "chatter on spindle for 2."},
      // Where nothing turns there is nothing to hear.
      {"standing", all, standing, "clear", 0, "collision on x for 2."},
      {"bare", kHead + kSpindle + kX, sound, "not-watched", 1, "chatter on spindle (no threshold)"},
      {"no threshold of x", kHead + kSpindle + kX + kChatter, sound, "partly-watched", 0,
       "collision on x (no threshold)"},
      {"x switched off", kHead + kSpindle + kX + kChatter + "[monitor.collision]\nenabled = no\n",
       sound, "clear", 0, "chatter on spindle for 2."},
      {"x missing", all, no_x, "partly-watched", 0, "collision on x (no signals)"},
      {"x unknown", kHead + kSpindle + kChatter, sound, "partly-watched", 0,
       "collision on x (incomplete machine file)"},
      {"slow", all, slow, "partly-watched", 0, "the spindle stayed below 955 rpm"},
      {"too fast", all, fast, "partly-watched", 0, "the spindle turned faster than 15000 rpm"},
      {"dead", all, dead, "warning", 0, "chatter on spindle for 0.802 s (signal faulty for 2 s)"},
      {"all dead", kHead + kSpindle + kChatter, nothing, "not-watched", 1, "signal faulty for 3 s"},
      {"frozen", all, frozen, "warning", 0, "collision on x for 0.6"},
      {"all stands", kHead + kSpindle + kChatter, only_standing, "not-watched", 1,
       "Nothing was watched; not watched: chatter on spindle (the spindle stood)"},
      {"turning axis", all, c_axis, "partly-watched", 0, "collision on c (no signals)"},
      {"second spindle", all, second, "partly-watched", 0, "chatter on spindle2 (no signals)"},
      {"asked for", all + "[monitor.wear]\ncutting_thrust_N = 20\n", sound, "partly-watched", 0,
       "wear (no signals)"},
  };
  for (const Case& c : cases) {
    put("m.ini", c.machine);
    record("t.csv", c.trace);
    const Outcome o =
        run("monitor --quiet --machine m.ini --trace t.csv --fail-on-alarm --json --report r.html");
    const Json json(o.out);
    that(json.ok && json.text("verdict") == c.verdict, o,
         std::string(c.name) + ": " + c.verdict + ", not " + json.text("verdict"), __LINE__);
    that(o.status == c.status, o, std::string(c.name) + ": status", __LINE__);
    that(contains(json.text("verdict_sentence"), c.says), o,
         std::string(c.name) + ": '" + json.text("verdict_sentence") + "' says " + c.says,
         __LINE__);
    CHECK_TEXT(json.text("alarms"), "0");
    for (const char* key : {"name", "channel", "runs", "reason", "watched_s"})
      that(json.text(std::string("monitors.0.") + key) != "(absent)", o,
           std::string("monitors have ") + key, __LINE__);
    const Outcome text = run("monitor --quiet --machine m.ini --trace t.csv");
    that(text.out.starts_with("Verdict: " + std::string(c.verdict) + ". " +
                              json.text("verdict_sentence")),
         text, "opens with the verdict", __LINE__);
    const std::string page = content(folder / "r.html");
    that(contains(page, c.verdict) && contains(page, json.text("verdict_sentence")), o,
         "the report says the same", __LINE__);
  }
}

}  // namespace

int main() {
  return in_own_folder("verdict", [] { verdicts(); });
}
