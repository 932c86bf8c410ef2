// What `identify idle` makes of records that are not a full idling run: one speed, a drive that
// stands, a cut, an effort that is none.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <random>
#include <string>
#include <utility>
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

constexpr const char* kAxes =
    "[machine]\nname = axes\n\n[axis.x]\nlead_m = 0.016\nencoder_counts_per_rev = "
    "65536\n\n[axis.y]\n"
    "lead_m = 0.016\nencoder_counts_per_rev = 65536\n";

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
          "--false-alarm-rate-per-hour 60");
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

// Nonsense in a record that is good otherwise: each is refused, or gives parameters that are right
// within three of their stated errors.
struct Nonsense {
  const char* name;
  std::function<void(Run& x, Run& y)> make;
};

void write_axes(const std::string& name, const Run& x, const Run& y) {
  std::string text = "t_s,x.angle_counts,x.force_N,y.angle_counts,y.force_N\n";
  char line[200];
  for (std::size_t i = 0; i < x.size(); ++i) {
    std::snprintf(line, sizeof line, "%.6f,%lld,%.9g,%lld,%.9g\n",
                  static_cast<double>(i) / kRate_hz, static_cast<long long>(x[i].counts),
                  x[i].effort, static_cast<long long>(y[i].counts), y[i].effort);
    text += line;
  }
  put(name, text);
}

void nonsense() {
  constexpr double kSeconds = 8;
  const oracle::FeedProgram others{
      {{.distance = 0.05, .speed = 0.2}, {.distance = 0.01, .speed = 0.06}}};
  ShopDrive x = axis_drive(), y = axis_drive();
  y.inertia = 120, y.viscous = 400, y.coulomb = 150;
  const auto feeds = [](double t) { return kFeeds.at(t); };
  const Run good_x = x.run(kSeconds, 51, feeds);
  const Run good_y = y.run(kSeconds, 52, [&](double t) { return others.at(t); });
  double highest = 0;
  for (const auto& s : good_x) highest = std::max(highest, std::abs(s.effort));
  const auto each = [](const std::function<void(ShopDrive::Sample&)>& change) {
    return [change](Run& run, Run&) { std::for_each(run.begin(), run.end(), change); };
  };
  std::mt19937 random(53);
  const std::vector<Nonsense> all = {
      {"as it is", [](Run&, Run&) {}},
      {"current 50 ms late",
       [](Run& run, Run&) {
         for (std::size_t i = run.size(); i-- > 0;)
           run[i].effort = run[i < 200 ? 0 : i - 200].effort;
       }},
      {"current 50 ms early",
       [](Run& run, Run&) {
         for (std::size_t i = 0; i + 200 < run.size(); ++i) run[i].effort = run[i + 200].effort;
       }},
      {"sign", each([](auto& s) { s.effort = -s.effort; })},
      {"size of the current", each([](auto& s) { s.effort = std::abs(s.effort); })},
      {"clipped",
       each([&](auto& s) { s.effort = std::clamp(s.effort, -0.3 * highest, 0.3 * highest); })},
      {"three levels", each([&](auto& s) {
         s.effort = std::abs(s.effort) < highest / 4 ? 0 : std::copysign(highest / 2, s.effort);
       })},
      {"axes swapped",
       [](Run& run, Run& other) {
         for (std::size_t i = 0; i < run.size(); ++i) std::swap(run[i].effort, other[i].effort);
       }},
      {"current of the other axis",
       [](Run& run, Run& other) {
         for (std::size_t i = 0; i < run.size(); ++i) run[i].effort = other[i].effort;
       }},
      {"a cut in the middle",
       [&](Run& run, Run&) {
         run = x.run(kSeconds, 54, feeds, [](double t, double, double v) {
           return t > 3 && t < 4.5 && v > 0.01 ? 400.0 : 0.0;
         });
       }},
      {"encoder backwards in time",
       [](Run& run, Run&) {
         for (std::size_t i = 0, j = run.size() - 1; i < j; ++i, --j)
           std::swap(run[i].counts, run[j].counts);
       }},
      {"one way",
       [&](Run& run, Run&) {
         const oracle::SpeedProgram one{
             .ramp_s = 0.1, .hold_s = 1, .speeds = {0, 0.05, 0.2, 0.1, 0.3, 0.02, 0.2, 0.1}};
         run = x.run(kSeconds, 55, [&](double t) { return one.at(t); });
       }},
      {"one speed",
       [&](Run& run, Run&) {
         const oracle::SpeedProgram one{.ramp_s = 0.1, .hold_s = 9, .speeds = {0.1, 0.1}};
         run = x.run(kSeconds, 56, [&](double t) { return one.at(t); });
       }},
      {"half of it frozen",
       [](Run& run, Run&) {
         for (std::size_t i = run.size() / 2; i < run.size(); ++i) run[i] = run[run.size() / 2];
       }},
      {"current frozen half of it",
       [](Run& run, Run&) {
         for (std::size_t i = run.size() / 2; i < run.size(); ++i)
           run[i].effort = run[run.size() / 2].effort;
       }},
      {"encoder frozen half of it",
       [](Run& run, Run&) {
         for (std::size_t i = run.size() / 2; i < run.size(); ++i)
           run[i].counts = run[run.size() / 2].counts;
       }},
      {"spikes", each([&](auto& s) {
         if (random() % 100 == 0) s.effort += random() % 2 == 0 ? 20 * highest : -20 * highest;
       })},
      {"rare spikes", each([&](auto& s) {
         if (random() % 2000 == 0) s.effort += 5 * highest;
       })},
  };
  for (const Nonsense& one : all) {
    Run a = good_x, b = good_y;
    one.make(a, b);
    write_axes("nonsense.csv", a, b);
    const Outcome o =
        run("identify idle --quiet --machine axes.ini --trace nonsense.csv --out ns.ini --json");
    std::string said = "refused: " + o.out.substr(0, 200);
    bool right = o.status == 3;
    if (o.status == 0) {
      const Json json(o.out);
      right = true;
      said.clear();
      for (int d = 0; d < 2; ++d) {
        const std::string at = "drives." + std::to_string(d) + ".";
        if (json.text(at + "parameters_learned") != "true") continue;
        const bool is_x = json.text(at + "channel") == "x";
        const ShopDrive& truth = is_x ? x : y;
        for (const auto& [key, value] : {std::pair{"equivalent_mass_kg", truth.inertia},
                                         std::pair{"viscous_friction_N_s_per_m", truth.viscous},
                                         std::pair{"coulomb_friction_N", truth.coulomb}}) {
          const double got = json.number(at + key + ".value");
          const double error = json.number(at + key + ".standard_error");
          right = right && std::abs(got - value) <= 3 * error;
          char text[120];
          std::snprintf(text, sizeof text, "%s%s %.4g +- %.2g (%.4g)", said.empty() ? "" : ", ",
                        is_x ? "x" : "y", got, error, value);
          said += text;
        }
      }
    }
    std::printf("  %s: %s\n", one.name, said.c_str());
    that(right, o, one.name, __LINE__);
  }
}

}  // namespace

int main() {
  return in_own_folder("idle_records", [] {
    put("bed.ini", kMachine);
    axis_that_stands();
    one_speed();
    a_cut();
    no_effort();
    put("axes.ini", kAxes);
    nonsense();
  });
}
