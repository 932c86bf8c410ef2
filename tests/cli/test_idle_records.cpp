// What `identify idle` makes of records that are not a full idling run: one speed, a drive that
// stands, a cut, an effort that is none.
#include <cmath>
#include <cstdio>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "oracles/idle_plant.hpp"
#include "oracles/shop_drive.hpp"
#include "program.hpp"

namespace {

using namespace program_test;
using oracle::ShopDrive;

constexpr double kRate_hz = 4000;
constexpr const char* kMachine =
    "[machine]\nname = test bed\n\n[spindle]\ninertia_kg_m2 = 0.002\nencoder_counts_per_rev = "
    "65536\n"
    "\n[axis.x]\nlead_m = 0.016\nencoder_counts_per_rev = 65536\nequivalent_mass_kg = "
    "200\n\n[tool]\n"
    "teeth = 2\ndiameter_m = 0.02\n";

ShopDrive spindle_drive() {
  ShopDrive d;
  d.inertia = 0.002, d.viscous = 4e-4, d.coulomb = 0.2, d.bristle = 1e-3, d.ripple_length = 6.28;
  d.ripple = 0.1, d.stribeck = 0.2, d.stribeck_speed = 5;
  d.period_s = 1 / kRate_hz, d.count = 2 * oracle::kPi / 65536;
  d.effort_noise = 0.01, d.position_gain_per_s = 0;
  return d;
}
ShopDrive axis_drive() {
  ShopDrive d;
  d.period_s = 1 / kRate_hz, d.count = 0.016 / 65536;
  return d;
}

using Run = std::vector<ShopDrive::Sample>;
void write(const std::string& name, const Run& spindle, const Run* axis) {
  std::string text = "t_s,spindle.angle_counts,spindle.torque_Nm";
  text += axis != nullptr ? ",x.angle_counts,x.force_N\n" : "\n";
  char line[160];
  for (std::size_t i = 0; i < spindle.size(); ++i) {
    std::snprintf(line, sizeof line, "%.6f,%lld,%.9g", static_cast<double>(i) / kRate_hz,
                  static_cast<long long>(spindle[i].counts), spindle[i].effort);
    text += line;
    if (axis != nullptr) {
      std::snprintf(line, sizeof line, ",%lld,%.9g", static_cast<long long>((*axis)[i].counts),
                    (*axis)[i].effort);
      text += line;
    }
    text += '\n';
  }
  put(name, text);
}

const oracle::SpeedProgram kTurning{.ramp_s = 0.4, .hold_s = 0.8, .speeds = {0, 150, 400, 800, 0}};
const oracle::FeedProgram kFeeds{
    {{.distance = 0.02, .speed = 0.05}, {.distance = 0.1, .speed = 0.3}}};

void axis_that_stands() {
  const Run spindle =
      spindle_drive().run(kTurning.length_s(), 11, [](double t) { return kTurning.at(t); });
  const Run still =
      axis_drive().run(kTurning.length_s(), 12, [](double) { return oracle::Motion{}; });
  write("stands.csv", spindle, &still);
  const Outcome o = run("identify idle --machine bed.ini --trace stands.csv --out s.ini --json");
  that(o.status == 0, o, "the others are learned", __LINE__);
  const Json json(o.out);
  CHECK_TEXT(json.text("drives.0.channel"), "spindle");
  CHECK_TEXT(json.text("drives.0.parameters_learned"), "true");
  CHECK_NEAR(json.number("drives.0.inertia_kg_m2.value"), 0.002, 2e-5);
  CHECK_TEXT(json.text("drives.1.channel"), "(absent)");
  that(contains(o.err, "x: the drive does not move") && contains(o.err, "stands while others"), o,
       "names the axis", __LINE__);
  const std::string machine = content(folder / "s.ini");
  CHECK(contains(machine, "equivalent_mass_kg = 200\n"));
  CHECK(!contains(machine, "threshold_x"));
  CHECK(contains(machine, "chatter_threshold_Nm2"));
}

// One speed long enough for a rate: the threshold, and friction as one figure.
void one_speed() {
  const oracle::SpeedProgram steady{.ramp_s = 0.1, .hold_s = 10, .speeds = {600, 600}};
  const ShopDrive d = spindle_drive();
  write("steady.csv", d.run(10, 21, [&](double t) { return steady.at(t); }), nullptr);
  const Outcome o = run("identify idle --machine bed.ini --trace steady.csv --out o.ini --json");
  that(o.status == 0, o, "thresholds are learned", __LINE__);
  const Json json(o.out);
  CHECK_TEXT(json.text("drives.0.parameters_learned"), "false");
  CHECK_TEXT(json.text("drives.0.inertia_kg_m2.value"), "(absent)");
  CHECK(json.number("drives.0.chatter_threshold_Nm2") > 0);
  // The accepted rate is kept, and printed.
  CHECK(json.number("drives.0.chatter_false_alarms_per_hour") <= 0.0101);
  CHECK_NEAR(json.number("drives.0.running_effort.speed_rad_s"), 600, 1);
  CHECK_NEAR(json.number("drives.0.running_effort.effort_Nm"), 0.2 + 4e-4 * 600, 0.01);
  that(contains(o.err, "one speed only") && contains(o.err, "thresholds alone"), o, "says so",
       __LINE__);
  CHECK(contains(content(folder / "o.ini"), "inertia_kg_m2 = 0.002\n"));
  const Outcome text = run("identify idle --machine bed.ini --trace steady.csv --out o.ini");
  that(contains(text.out, "in 1") || contains(text.out, "hours"), text, "the rate in words",
       __LINE__);
  that(contains(text.out, "next: 'servosense monitor --machine o.ini"), text, "what comes next",
       __LINE__);
  const Outcome often =
      run("identify idle --machine bed.ini --trace steady.csv --out o2.ini --json "
          "--false-alarm-rate-per-hour 1000");
  const Json loose(often.out);
  CHECK(loose.number("drives.0.chatter_threshold_Nm2") <=
        json.number("drives.0.chatter_threshold_Nm2"));

  // All drives stand: what they hear at rest.
  const Run still = axis_drive().run(4, 22, [](double) { return oracle::Motion{}; });
  ShopDrive off = d;
  write("rest.csv", off.run(4, 23, [](double) { return oracle::Motion{}; }), &still);
  const Outcome rest = run("identify idle --machine bed.ini --trace rest.csv --out r.ini --json");
  that(rest.status == 0, rest, "standstill teaches", __LINE__);
  CHECK(contains(content(folder / "r.ini"), "threshold_x_N_per_s"));
}

void a_cut() {
  const ShopDrive d = spindle_drive();
  // Two teeth at small immersion: torque for a quarter of the turn of each; first air, then the
  // cut.
  const auto cutting = [](double from_s, double to_s) {
    return [=](double t, double x, double) {
      if (t < from_s || t > to_s) return 0.0;
      const double turn = std::fmod(x, oracle::kPi);
      return turn < oracle::kPi / 4 ? 3.0 : 0.0;
    };
  };
  const oracle::SpeedProgram steady{.ramp_s = 0.1, .hold_s = 8, .speeds = {300, 300}};
  const auto at = [&](double t) { return steady.at(t); };
  write("entry.csv", d.run(8, 31, at, cutting(3, 6)), nullptr);
  write("throughout.csv", d.run(8, 32, at, cutting(-1, 99)), nullptr);
  const oracle::SpeedProgram program{.ramp_s = 0.4, .hold_s = 2, .speeds = {0, 150, 400, 0}};
  write("program.csv",
        d.run(
            program.length_s(), 33, [&](double t) { return program.at(t); }, cutting(3.5, 4.5)),
        nullptr);
  for (const char* trace : {"entry.csv", "throughout.csv", "program.csv"}) {
    refused("identify idle --quiet --machine bed.ini --out cut.ini --trace " + std::string(trace),
            3, {"spindle is not idle", "in the air"}, __LINE__);
    CHECK(!fs::exists(folder / "cut.ini"));
  }
  // Friction that falls by a third while the bearings warm, and by a tenth with each turn, is none.
  ShopDrive warm = d;
  const auto warming = [](double t, double, double) { return 0.1 * (1 - t / 8); };
  write("warm.csv", warm.run(8, 34, at, warming), nullptr);
  const Outcome o = run("identify idle --quiet --machine bed.ini --trace warm.csv --out w.ini");
  that(o.status == 0, o, "varying friction is idle", __LINE__);
}

void no_effort() {
  const Run spindle =
      spindle_drive().run(kTurning.length_s(), 41, [](double t) { return kTurning.at(t); });
  std::mt19937 random(42);
  std::normal_distribution<double> normal;
  Run other = spindle;
  for (auto& s : other) s.effort = normal(random);
  write("random.csv", other, nullptr);
  refused("identify idle --quiet --machine bed.ini --trace random.csv --out n.ini", 3,
          {"% of its change is left"}, __LINE__);
  for (auto& s : other) s.effort = 0.5;
  write("constant.csv", other, nullptr);
  refused("identify idle --quiet --machine bed.ini --trace constant.csv --out n.ini", 3,
          {"never changes"}, __LINE__);
  CHECK(!fs::exists(folder / "n.ini"));
}

}  // namespace

int main() {
  return in_own_folder("idle_records", [] {
    put("bed.ini", kMachine);
    axis_that_stands();
    one_speed();
    a_cut();
    no_effort();
  });
}
