// `monitor --cnc` with [override]: what is commanded about a simulated cut that chatters, inside
// the limits, to a speed that the simulated structure stands; and nothing without the section.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "check.hpp"
#include "cli/chattering_machine.hpp"
#include "program.hpp"
#include "servosense/identify/semi_discretization.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace {

using namespace program_test;
using namespace servosense;

constexpr const char* kOverride =
    "\n[override]\nspeed_ratio = 0.6 1.4\nfeed_ratio = 0.5 1\nspeed_rate_per_s = 1\n"
    "feed_rate_per_s = 1\n";
const std::string kRun = "monitor --trace cut.csv --cnc simulated --machine ";

void tests() {
  const chattering_machine::Given g{4, 3700, 0.0006, 620};
  const std::string text = chattering_machine::machine_of(g);
  put("cut.ini", text);
  chattering_machine::learn("cut.ini");
  Outcome o = run("simulate milling --machine cut.ini --out cut.csv");
  that(o.status == 0, o, "cuts", __LINE__);

  // Off without the section: a chatter alarm holds the feed.
  o = run(kRun + "learned.ini");
  that(contains(o.out, "feed hold: asked for 1 time(s)") && !contains(o.out, "overrides"), o,
       "holds", __LINE__);
  refused(kRun + "learned.ini --commands told.jsonl", 2, {"[override]"}, __LINE__);

  put("loop.ini", content(folder / "learned.ini") + kOverride);
  o = run(kRun + "loop.ini --commands told.jsonl");
  that(o.status == 0 && contains(o.err, "chatter: spindle to ") &&
           contains(o.out, "feed hold: not asked for") && contains(o.out, "overrides: "),
       o, "moves the spindle and says so", __LINE__);
  double target = 1, before_s = 0, before = 1;
  bool advised = false;
  for (const std::string& line : lines(content(folder / "told.jsonl"))) {
    const Json json(line);
    that(json.ok, o, line, __LINE__);
    const double speed = json.number("speed_ratio"), feed = json.number("feed_ratio");
    const double t_s = json.number("t_s");
    CHECK(speed >= 0.6 && speed <= 1.4 && feed >= 0.5 && feed <= 1);
    CHECK(feed <= speed + 1e-9);  // chips no thicker
    CHECK(std::abs(speed - before) <= t_s - before_s + 1e-9);
    CHECK_TEXT(json.text("hold"), "false");
    advised = advised || json.text("phase") == "advised";
    if (json.text("phase") == "advised") target = speed;
    before_s = t_s;
    before = speed;
  }
  CHECK(advised);
  const auto m = *milling_simulation(*MachineFile::parse(text, "cut.ini"), 1);
  const auto exact = *SemiDiscretization::create(m.structure, m.tool, m.cut);
  check::figure("commanded speed, of the programmed one", target);
  CHECK(exact.spectral_radius(g.rpm, g.depth_m) > 1);
  // The last line may be one percent before it.
  CHECK(std::abs(target - 1) > 0.02 &&
        std::min(exact.spectral_radius(target * g.rpm, g.depth_m),
                 exact.spectral_radius((target + std::copysign(0.01, target - 1)) * g.rpm,
                                       g.depth_m)) < 1);

  // Nothing stable inside the limits: said, and held.
  put("narrow.ini", content(folder / "learned.ini") +
                        "\n[override]\nspeed_ratio = 0.99 1.01\nfeed_ratio = 0.8 1\n"
                        "patience_s = 0.05\n");
  o = run(kRun + "narrow.ini");
  that(contains(o.err, "no stable speed is known inside the limits") &&
           contains(o.out, "feed hold: asked for 1 time(s)"),
       o, "gives up aloud", __LINE__);

  put("thick.ini",
      content(folder / "learned.ini") + "\n[override]\nspeed_ratio = 0.7 1\nfeed_ratio = 0.9 1\n");
  refused(kRun + "thick.ini", 3, {"thick.ini:", "least_feed", "thicker chips"}, __LINE__);
  refused("monitor --trace cut.csv --machine loop.ini --commands told.jsonl", 2, {"--cnc"},
          __LINE__);
}

}  // namespace

int main() { return program_test::in_own_folder("overrides", tests); }
