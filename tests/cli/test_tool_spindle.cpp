// The tool on the second spindle: everything that is said of it on the first is said there, and the
// spindle without a tool has none of it. The cut is a torque in closed form, a tooth lost midway.
#include <cmath>
#include <random>

#include "check.hpp"
#include "oracles/drive_plant.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

constexpr double kRate_hz = 8000, kTurn_rad_s = 100 * oracle::kPi;
constexpr int kTeeth = 4;
constexpr double kCut_s = 1, kLost_s = 4, kEnd_s = 6;

/// Torque of four teeth over half a turn each, run-out left out; one is gone from kLost_s on.
double cutting_Nm(double t, double angle) {
  if (t < kCut_s) return 0;
  double torque = 0;
  for (int tooth = 0; tooth < kTeeth; ++tooth) {
    const double phi = std::fmod(angle + 2 * oracle::kPi * tooth / kTeeth, 2 * oracle::kPi);
    if (t > kLost_s && tooth == 1) continue;
    // The tooth behind a lost one takes both chips.
    const double chip = t > kLost_s && tooth == 2 ? 2 : 1;
    if (phi < oracle::kPi) torque += 2 * chip * std::sin(phi);
  }
  return torque;
}

struct Names {
  std::string cuts, other;
};

void record(const std::string& file, const Names& names, bool cut, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise_Nm(0, 0.02);
  std::string text = "t_s," + names.cuts + ".angle_rad," + names.cuts + ".torque_Nm," +
                     names.other + ".angle_rad," + names.other + ".torque_Nm\n";
  char row[160];
  for (int n = 0; n < kEnd_s * kRate_hz; ++n) {
    const double t = n / kRate_hz, angle = kTurn_rad_s * t;
    const double of_cut = 0.3 + noise_Nm(random) + (cut ? cutting_Nm(t, angle) : 0);
    std::snprintf(row, sizeof row, "%.9g,%.12g,%.6g,%.12g,%.6g\n", t, angle, of_cut, angle / 2,
                  0.3 + noise_Nm(random));
    text += row;
  }
  put(file, text);
}

std::string file_of(const Names& names) {
  std::string text = "[machine]\nsample_rate_hz = 8000\n[tool]\nteeth = 4\ndiameter_m = 0.05\n";
  if (names.cuts != "spindle") text += "spindle = " + names.cuts + "\n";
  for (const std::string& name : {names.cuts, names.other})
    text += "[" + name + "]\ninertia_kg_m2 = 0.01\ncoulomb_friction_Nm = 0.3\n";
  return text;
}

/// The same with the names of the spindles exchanged.
std::string exchanged(std::string text) {
  const auto replace = [&](const std::string& from, const std::string& to) {
    for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
      text.replace(at, from.size(), to);
  };
  replace("\"spindle2\"", "SECOND");
  replace("\"spindle\"", "\"spindle2\"");
  replace("SECOND", "\"spindle\"");
  return text;
}

std::vector<std::string> states(const std::string& events) {
  std::vector<std::string> all;
  for (const std::string& line : lines(events)) {
    const Json json(line);
    all.push_back(json.text("t_s") + " " + json.text("monitor") + " " + json.text("channel") + " " +
                  json.text("state") + " " + json.text("value"));
  }
  std::sort(all.begin(), all.end());
  return all;
}

void the_same_is_said_of_it() {
  const Names first{"spindle", "spindle2"}, second{"spindle2", "spindle"};
  std::vector<std::string> said[2];
  for (const Names& names : {first, second}) {
    record("air.csv", names, false, 1);
    record("cut.csv", names, true, 2);
    put("m.ini", file_of(names));
    const Outcome idle = run("identify idle --machine m.ini --trace air.csv --out learned.ini");
    that(idle.status == 0, idle, "learns", __LINE__);
    const std::string learned = content(folder / "learned.ini");
    CHECK(contains(learned, "[monitor.tooth-breakage]\n"));
    CHECK(contains(learned, "noise_Nm"));
    const Outcome o = run(
        "monitor --machine learned.ini --trace cut.csv --events e.jsonl --json --report r.html");
    that(o.status == 0, o, "monitors", __LINE__);
    const Json json(o.out);
    bool broken = false;
    std::string events = content(folder / "e.jsonl");
    for (const std::string& state : states(events))
      broken = broken || contains(state, "tooth-breakage tool alarm");
    CHECK(broken);
    if (names.cuts == "spindle2") events = exchanged(events);
    said[names.cuts == "spindle2" ? 1 : 0] = states(events);
  }
  CHECK(said[0].size() > 4);
  CHECK(said[0] == said[1]);
  if (said[0] != said[1])
    for (int i : {0, 1})
      for (const std::string& line : said[i]) std::cout << i << ' ' << line << '\n';

  // Without the key the first spindle has the tool, which turns in the air.
  put("wrong.ini", [] {
    std::string text = content(folder / "learned.ini");
    const std::string key = "spindle = spindle2";
    text.erase(text.find(key), key.size());
    return text;
  }());
  const Outcome wrong = run("monitor --machine wrong.ini --trace cut.csv --events e.jsonl");
  that(wrong.status == 0, wrong, "monitors", __LINE__);
  for (const std::string& state : states(content(folder / "e.jsonl")))
    CHECK(!contains(state, "tool alarm"));
}

void other_commands_follow() {
  const Names names{"spindle2", "spindle"};
  record("sound.csv", names, true, 3);
  put("m.ini", file_of(names) + "[monitor.collision]\ncutting_torque_Nm = 0.3\n");
  const Outcome band = run("identify torque-band --machine m.ini --out band.csv sound.csv --json");
  that(band.status == 0, band, "learns the torque of the program", __LINE__);
  double most = 0;
  for (const std::string& line : lines(content(folder / "band.csv")))
    if (std::isdigit(static_cast<unsigned char>(line[0])) != 0)
      most = std::max(most, std::strtod(line.c_str() + line.find(',') + 1, nullptr));
  // Mean of the cut: four teeth of 2 sin over half a turn.
  CHECK_NEAR(most, kTeeth * 2 / oracle::kPi, 0.4);

  const Outcome exported = run("export --c m.ini --out m.h");
  that(exported.status == 0, exported, "is written", __LINE__);
  CHECK(contains(exported.out, "[spindle] is not carried over"));
  CHECK(!contains(exported.out, "[spindle2] is not carried over"));

  const Outcome milling = run("simulate milling --machine m.ini --out no.csv");
  that(milling.status == 3 && contains(milling.err, "simulated on [spindle] alone"), milling,
       "is refused", __LINE__);

  put("none.ini", "[machine]\nsample_rate_hz = 8000\n[tool]\nspindle = spindle3\n");
  const Outcome none = run("monitor --machine none.ini --trace sound.csv");
  that(none.status == 3 && contains(none.err, "spindle spindle2"), none, "names the choices",
       __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("tool_spindle", [] {
    the_same_is_said_of_it();
    other_commands_follow();
  });
}
