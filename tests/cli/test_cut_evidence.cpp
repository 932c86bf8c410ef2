// Cuts that the program has watched become evidence for the cut that it recommends: from simulated
// records to the map, without a line written by hand.
#include <cmath>
#include <string>

#include "check.hpp"
#include "cli/chattering_machine.hpp"
#include "program.hpp"

namespace {

using namespace program_test;
using chattering_machine::replaced;

constexpr double kDepth_m = 0.0004, kRpm = 3700;

std::string cutting_at(double rpm) {
  return replaced(chattering_machine::machine_of({4, rpm, kDepth_m, 620}), "duration_s = 1.2",
                  "duration_s = 2.2");
}

Outcome watched(const std::string& machine, const std::string& trace) {
  const Outcome o =
      run("monitor --machine " + machine + " --trace " + trace + " --cuts cuts.jsonl --json");
  that(o.status == 0, o, "monitors", __LINE__);
  return o;
}

std::size_t nearest_speed(const Json& map, double rpm) {
  std::size_t best = 0;
  const auto off = [&](std::size_t i) {
    return std::abs(map.number("map." + std::to_string(i) + ".spindle_speed_rpm") - rpm);
  };
  for (std::size_t i = 1; i < map.sizes.at("map"); ++i)
    if (off(i) < off(best)) best = i;
  return best;
}

void from_monitor() {
  put("cut.ini", cutting_at(kRpm));
  chattering_machine::learn("cut.ini");

  // In the air there is no cut.
  const Outcome air = watched("learned.ini", "idle.csv");
  that(contains(air.err, "gave no line") && !contains(air.err, "written"), air,
       "says why there is none", __LINE__);
  CHECK(content(folder / "cuts.jsonl").empty());

  that(run("simulate milling --machine cut.ini --out cut.csv --quiet").status == 0, air, "cuts",
       __LINE__);
  const Outcome chattered = watched("learned.ini", "cut.csv");
  that(contains(chattered.err, "0 stable cuts and 1 chattering cut written"), chattered,
       "says what", __LINE__);
  const auto one = lines(content(folder / "cuts.jsonl"));
  CHECK(one.size() == 1);
  if (one.empty()) return;
  const Json line(one[0]);
  CHECK_NEAR(line.number("spindle_speed_rpm"), kRpm, 0.01 * kRpm);
  CHECK_NEAR(line.number("axial_depth_m"), kDepth_m, 1e-12);
  CHECK_NEAR(line.number("radial_immersion_m"), 0.004, 1e-12);
  CHECK_TEXT(line.text("stable"), "false");
  CHECK_TEXT(line.text("direction"), "down");
  CHECK_NEAR(line.number("chatter_hz"), Json(chattered.out).number("advice.chatter_hz"), 1e-9);

  // At a speed that the alarm advises the same cut is stable.
  const double better_rpm = Json(chattered.out).number("advice.speeds_rpm.0");
  CHECK(better_rpm > 0);
  put("better.ini", cutting_at(better_rpm));
  run("simulate milling --machine better.ini --out better.csv --quiet");
  const Outcome stable = watched("learned.ini", "better.csv");
  that(contains(stable.err, "1 stable cut and 0 chattering cuts written"), stable, "says what",
       __LINE__);
  const auto two = lines(content(folder / "cuts.jsonl"));
  CHECK(two.size() == 2);
  if (two.size() < 2) return;
  CHECK(two[0] == one[0]);
  CHECK_TEXT(Json(two[1]).text("stable"), "true");
  CHECK_NEAR(Json(two[1]).number("spindle_speed_rpm"), better_rpm, 0.01 * better_rpm);

  // A shop without a hammer.
  std::string text = content(folder / "learned.ini");
  const auto from = text.find("[structure.x]"), to = text.find("[simulation]");
  CHECK(from < to && to != std::string::npos);
  put("bare.ini", text.erase(from, to - from));
  const Outcome o = run("recommend --machine bare.ini --cuts cuts.jsonl --json --quiet");
  that(o.status == 0, o, "takes what monitor wrote", __LINE__);
  const Json after(o.out);
  CHECK(after.number("evidence.cuts") == 2);
  CHECK(after.number("evidence.chatter_probability.0") > 0.8);
  CHECK(after.number("evidence.chatter_probability.1") < 0.2);
  // Without them the limit is believed to be 0.7 to 0.8 mm at both.
  const auto limit_m = [&](double rpm) {
    return after.number("map." + std::to_string(nearest_speed(after, rpm)) +
                        ".middle_axial_depth_m");
  };
  check::figure("limit where it chattered [mm]", 1e3 * limit_m(kRpm));
  check::figure("where it was stable [mm]", 1e3 * limit_m(better_rpm));
  CHECK(limit_m(kRpm) < kDepth_m && limit_m(better_rpm) > kDepth_m);

  // What is there already is not lost, and nothing else is added to.
  put("notes.txt", "a note\n");
  const Outcome other = run("monitor --machine learned.ini --trace cut.csv --cuts notes.txt");
  that(other.status == 3 && one_sentence(other.err), other, "refuses", __LINE__);
  CHECK(content(folder / "notes.txt") == "a note\n");
  const Outcome full = run("monitor --machine learned.ini --trace cut.csv --cuts /dev/full");
  that(full.status == 4 && contains(full.out, "Verdict: alarm"), full, "says so at the end",
       __LINE__);
}

// Koike 2016: the ramp of the shipped machine passes four stable speeds.
void from_pockets() {
  put("koike.ini", content("examples/machines/koike_cut.ini"));
  run("simulate milling --machine koike.ini --out ramp.csv --quiet");
  const Outcome o = run("pockets --machine koike.ini --trace ramp.csv --cuts ramp.jsonl");
  that(o.status == 0 && contains(o.err, "chattering speeds written"), o, "writes", __LINE__);
  // At the speeds found the limit is 9.6 to 11.9 mm, and the cut is 15 mm deep: none is stable.
  const auto cuts = lines(content(folder / "ramp.jsonl"));
  CHECK(cuts.size() >= 3);
  for (const std::string& line : cuts) {
    const Json cut(line);
    CHECK_NEAR(cut.number("axial_depth_m"), 0.015, 1e-12);
    CHECK_TEXT(cut.text("stable"), "false");
    // Chatter is above the mode, by less than in the pockets.
    CHECK_BETWEEN(cut.number("chatter_hz"), 2082, 1.07 * 2082);
  }
  // A ramp in the cut is none of the cuts that monitor can tell of.
  const Outcome m = run("monitor --machine koike.ini --trace ramp.csv --cuts none.jsonl");
  that(m.status == 0 && contains(m.err, "no cut was written"), m, "says why", __LINE__);
}

}  // namespace

int main(int argc, char** argv) {
  return in_own_folder("cut_evidence", [&] {
    from_monitor();
    if (check::nightly(argc, argv)) from_pockets();
  });
}
