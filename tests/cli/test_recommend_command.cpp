// servosense recommend as a user meets it.
#include <cmath>
#include <cstdlib>
#include <string>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

const std::string kTool =
    "[tool]\ndiameter_m = 0.016\nteeth = 4\ntangential_coefficient_N_per_m2 = 8e8\n"
    "tangential_edge_N_per_m = 1e4\nradial_ratio = 0.3\nrunout_m = 0\n[cut]\nspindle_speed_rpm = "
    "9000\nfeed_per_tooth_m = 1e-4\naxial_depth_m = 0.002\nradial_immersion_m = 0.008\ndirection = "
    "down\n";
const std::string kErrors =
    "[limits]\nspindle_speed_rpm = 11000 14000\nfeed_per_tooth_m = 1e-4\n"
    "axial_depth_m = 0.03\n";
const std::string kModes =
    "[structure.x]\nmodes = 900 0.03 0.4\nmodes_relative_error = 0.002 0.04 "
    "0.04\n[structure.y]\nmodes = 950 0.03 0.4\n";

void advises() {
  put("m.ini", kTool + kErrors + kModes + "modes_relative_error = 0.002 0.04 0.04\n");
  const Outcome o = run("recommend --machine m.ini --json --report r.html");
  that(o.status == 0, o, "works", __LINE__);
  that(contains(o.err, "tangential_coefficient_relative_error") && contains(o.err, "11 %"), o,
       "says which error is not stated", __LINE__);
  that(!contains(o.err, "modes_relative_error"), o, "and not what is", __LINE__);
  const Json json(o.out);
  that(json.ok && json.object, o, "one JSON object", __LINE__);
  CHECK_TEXT(json.text("verdict"), "found");
  CHECK_BETWEEN(json.number("probability_stable"), 0.94, 0.96);
  CHECK_BETWEEN(json.number("spindle_speed_rpm"), 11000, 14000);
  CHECK_NEAR(json.number("feed_per_tooth_m"), 1e-4, 1e-12);
  CHECK_NEAR(
      json.number("removal_m3_s"),
      json.number("axial_depth_m") * 0.008 * 1e-4 * 4 * json.number("spindle_speed_rpm") / 60,
      1e-9);
  CHECK(json.number("removal_if_known_m3_s") > json.number("removal_m3_s"));
  const std::string page = content(folder / "r.html");
  CHECK(contains(page, "Probability that a cut is stable") && contains(page, "advised cut"));

  // The surer, the shallower; a limit of power holds the feed or depth back.
  const Json surer(run("recommend --machine m.ini --json --quiet --probability 0.99").out);
  CHECK(surer.number("removal_m3_s") < json.number("removal_m3_s"));
  put("weak.ini", content(folder / "m.ini") + "[spindle]\nrated_power_W = 800\n");
  const Json weak(run("recommend --machine weak.ini --json --quiet").out);
  bool found = false;
  for (std::size_t i = 0; i < weak.sizes.at("limits"); ++i) {
    const std::string at = "limits." + std::to_string(i);
    if (weak.text(at + ".name") != "power_W") continue;
    found = true;
    CHECK_TEXT(weak.text(at + ".binds"), "true");
    CHECK_NEAR(weak.number(at + ".value"), 800, 8);
  }
  CHECK(found);
}

void learns() {
  put("bare.ini", kTool + kErrors);
  const Json before(run("recommend --machine bare.ini --json --quiet").out);
  CHECK_TEXT(before.text("verdict"), "uncertain");
  put("cuts.jsonl",
      "{\"spindle_speed_rpm\": 12000, \"axial_depth_m\": 0.004, \"stable\": true}\n"
      "{\"spindle_speed_rpm\": 13000, \"axial_depth_m\": 0.008, \"stable\": true}\n");
  const Outcome o = run("recommend --machine bare.ini --cuts cuts.jsonl --json --quiet");
  that(o.status == 0 && o.err.empty(), o, "silent success", __LINE__);
  const Json after(o.out);
  CHECK(after.number("axial_depth_m") > 1.5 * before.number("axial_depth_m"));
  CHECK(after.number("evidence.cuts") == 2 &&
        after.number("evidence.least_effective_share") >= 0.5);
}

void refuses() {
  const auto refused = [](const std::string& arguments, int status, const std::string& part,
                          int line) {
    const Outcome o = run("recommend " + arguments);
    that(o.status == status && one_sentence(o.err) && contains(o.err, part), o, "refused", line);
  };
  put("frf.ini", kTool + kErrors + "[structure.x]\nfrf = f.csv\n");
  refused("--machine frf.ini", 3, "identify modes", __LINE__);
  put("two.ini", kTool + kErrors + kModes + "modes_relative_error = 0.1 0.1 0.1, 0.1 0.1 0.1\n");
  refused("--machine two.ini --quiet", 3, "one triple a mode", __LINE__);
  put("turned.ini", kTool + "[limits]\nspindle_speed_rpm = 9000 3000\n" + kModes);
  refused("--machine turned.ini --quiet", 3, "least and the greatest", __LINE__);
  refused("--machine m.ini --probability 1.5", 2, "--probability", __LINE__);
  put("empty.jsonl", "\n");
  refused("--machine m.ini --quiet --cuts empty.jsonl", 3, "--cuts", __LINE__);
  put("bad.jsonl", "{\"spindle_speed_rpm\": 1}\n");
  refused("--machine m.ini --quiet --cuts bad.jsonl", 3, "axial_depth_m", __LINE__);
}

}  // namespace

int main() {
  return in_own_folder("recommend", [] {
    advises();
    learns();
    refuses();
  });
}
