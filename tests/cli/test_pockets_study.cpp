// Stable speeds from random records as controllers write them: how many of the speeds are right,
// whether the advice is, and whether a stated uncertainty holds. A few of them; --nightly:
// development records; `SEED COUNT`: others, as in docs/stable-speeds.md.
#include <cstdlib>

#include "pocket_records.hpp"
#include "program.hpp"
#include "servosense/identify/semi_discretization.hpp"

namespace {

using namespace program_test;
using pocket_records::Pocket;
using pocket_records::Record;
using namespace servosense;

struct Tally {
  int records = 0, found = 0, unclear = 0, insufficient = 0, hidden = 0, refused = 0;
  int speeds = 0, near = 0, within_1 = 0, no_pockets = 0, covered = 0;
  int wrong_deeper = 0;
  int chattering = 0, truly_chattering = 0;  // lines of --cuts
};

// Chatter during so much of the ramp is enough: docs/stable-speeds.md.
constexpr double kChattering = 0.3;

// What the ramps say of cuts, against the limit of the linear cut at that speed.
void score_cuts(const Record& r, Tally& tally, std::string& line) {
  for (const std::string& text : lines(content(folder / "cuts.jsonl"))) {
    const Json cut(text);
    const double rpm = cut.number("spindle_speed_rpm");
    const double over_limit = r.depth_m / r.truth.limit_at(rpm);
    CHECK_TEXT(cut.text("stable"), "false");
    ++tally.chattering;
    tally.truly_chattering += over_limit > 1;
    char shown[60];
    std::snprintf(shown, sizeof shown, " c%.0f:%.2f", rpm, over_limit);
    line += shown;
  }
}

void score(const Record& r, Tally& tally, bool shown) {
  fs::remove(folder / "cuts.jsonl");
  const Outcome o = run("pockets --machine m.ini --trace t.csv --json --cuts cuts.jsonl");
  const Json json(o.out);
  ++tally.records;
  std::string line = std::to_string(r.seed) + " " + r.text + ": ";
  const std::string verdict = json.text("verdict");
  if (o.status != 0) {
    ++tally.refused;
    line += o.err;
  } else if (verdict == "found") {
    ++tally.found;
    for (std::size_t i = 0; i < json.sizes.at("stable_speeds"); ++i) {
      const std::string at = "stable_speeds." + std::to_string(i);
      const double rpm = json.number(at + ".spindle_speed_rpm");
      const double uncertainty = json.number(at + ".uncertainty_rpm");
      double error = 1e9;
      for (const Pocket& p : r.truth.pockets)
        if (std::abs(rpm - p.rpm) < std::abs(error)) error = rpm - p.rpm;
      ++tally.speeds;
      tally.near += std::abs(error) <= 30;
      tally.within_1 += std::abs(error) <= 0.01 * rpm;
      tally.no_pockets += std::abs(error) > 0.02 * rpm;
      tally.covered += std::abs(error) <= uncertainty;
      char text[60];
      std::snprintf(text, sizeof text, " %.0f%+.0f(%.0f)", rpm, error, uncertainty);
      line += text;
    }
  } else if (verdict == "insufficient-chatter") {
    ++tally.insufficient;
    const bool wrong = contains(json.text("sentence"), "deeper") && r.chatter_share >= kChattering;
    tally.wrong_deeper += wrong;
    line += (wrong ? "WRONG " : "") + json.text("sentence");
  } else {
    ++(verdict == "hidden" ? tally.hidden : tally.unclear);
    line += verdict;
  }
  score_cuts(r, tally, line);
  if (shown) std::printf("%s\n", line.c_str());
  std::fflush(stdout);
}

// The truth by another way: semi-discretisation has its deepest cut at the same speed, to 0.1 %.
void truth_is_converged() {
  const Record r = pocket_records::draw_record(850006);
  const pocket_records::Tool& t = r.tool;
  MillingTool tool;
  tool.diameter_m = t.diameter_m;
  tool.teeth = t.teeth;
  tool.force.tangential_coefficient_N_per_m2 = t.tangential_Pa;
  tool.force.radial_ratio = t.radial_ratio;
  const MillingCut cut{r.top_rpm, t.feed_m, r.depth_m, t.immersion_m,
                       t.down ? MillingDirection::down : MillingDirection::up};
  const Structure structure{{{t.x.hz, t.x.damping, t.x.mass_kg}},
                            {{t.y.hz, t.y.damping, t.y.mass_kg}}};
  const auto other = SemiDiscretization::create(structure, tool, cut);
  CHECK(other.has_value());
  CHECK(!r.truth.pockets.empty());
  if (!other || r.truth.pockets.empty()) return;
  const Pocket& p = r.truth.pockets.front();
  const auto depth = [&](double rpm) { return other->limit_at(rpm, 2 * p.depth_m).axial_depth_m; };
  CHECK_NEAR(depth(p.rpm) / p.depth_m, 1, 0.03);
  CHECK(depth(p.rpm) > depth(0.998 * p.rpm));
  CHECK(depth(p.rpm) > depth(1.002 * p.rpm));
}

Tally study(std::uint64_t first, int count, bool shown) {
  Tally tally;
  for (int i = 0; i < count; ++i) {
    Record r = pocket_records::draw_record(first + static_cast<std::uint64_t>(i));
    pocket_records::cut_record(r);
    put("m.ini", r.machine);
    put("t.csv", r.trace);
    score(r, tally, shown);
  }
  check::figure("records", tally.records);
  check::figure("answered with speeds", tally.found);
  check::figure("unclear", tally.unclear);
  check::figure("hidden", tally.hidden);
  check::figure("insufficient chatter", tally.insufficient);
  check::figure("no ramp or too few teeth", tally.refused);
  check::figure("advised a deeper cut where there was chatter", tally.wrong_deeper);
  check::figure("speeds", tally.speeds);
  check::figure("within 30 rpm", tally.near);
  check::figure("within 1 %", tally.within_1);
  check::figure("no pocket (off by more than 2 %)", tally.no_pockets);
  check::figure("within their uncertainty", tally.covered);
  check::figure("lines of chattering cuts", tally.chattering);
  check::figure("truly unstable", tally.truly_chattering);
  return tally;
}

}  // namespace

int main(int argc, char** argv) {
  return in_own_folder("pockets_study", [&] {
    if (argc > 2) {
      study(std::strtoull(argv[1], nullptr, 10), std::atoi(argv[2]), true);
      CHECK(true);
      return;
    }
    truth_is_converged();
    const bool nightly = check::nightly(argc, argv);
    const Tally t = nightly ? study(850000, 40, true) : study(209, 2, true);
    CHECK(t.wrong_deeper == 0);
    CHECK(t.chattering > 0 && 20 * t.truly_chattering >= 19 * t.chattering);
    CHECK(20 * t.no_pockets <= t.speeds);
    CHECK(10 * t.covered >= 9 * t.speeds);
    CHECK(nightly ? t.found >= 20 : t.speeds == 6);
  });
}
