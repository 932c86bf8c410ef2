// A wrong tool told from stock and wear: parts of six passes are predicted with the tool of the
// program and cut with another number of teeth, another diameter, another height of the stock, a
// worn edge, a pass too deep; beside them sound runs and others that only look like a fault:
// run-out, an override, stock and material at the ends of what is sound. Forces, machine and
// controller are those of the second generator (detection/milled_passes.hpp), which has no law in
// common with the prediction. What the last alarm of a run says is the verdict. Figures:
// docs/torque-band.md.
//
//   wrong_tool [--cases N] [--from SEED]    --nightly: 12 parts
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/milled_passes.hpp"
#include "predicted_part.hpp"
#include "program.hpp"
#include "seed_range.hpp"
#include "servosense/monitors/event_text.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace {

using namespace servosense;
using namespace program_test;
namespace passes = detection::passes;
using detection::second::Draw;
using passes::Course;
using passes::Part;

enum Kind { sound, runout, teeth, wider, narrower, worn, blunt, high, low, one_pass, kKinds };
constexpr std::array kNames = {"sound",
                               "sound, run-out of 0.3 to 0.5 of the feed",
                               "another number of teeth",
                               "diameter 1.25 to 1.6 times",
                               "diameter 0.6 to 0.8 times",
                               "worn, 1.3 to 1.6 times the force",
                               "worn, 3 to 6 times the edge force",
                               "stock higher by 0.4 to 1 of the least depth",
                               "stock lower by 0.4 to 0.7 of the least depth",
                               "one pass 1.5 to 2 times as deep"};
enum Said {
  silent,
  nothing,
  counted,
  larger,
  smaller,
  every,
  too_high,
  too_low,
  here,
  open,
  kSaid
};
constexpr std::array kSays = {"silent", "no cause", "teeth",   "larger", "smaller",
                              "worn",   "too high", "too low", "here",   "not told"};

struct Row {
  int runs = 0, above = 0, below = 0;
  int right_count = 0;     // of `counted`: as many as there are
  int leaves_it_open = 0;  // of `open`: the truth is among what is named
  std::array<int, kSaid> last{};
};
std::array<Row, kKinds> rows;

/// Six passes on a block of their own, so far apart that no other tool reaches from one to another.
Part draw(std::uint64_t seed) {
  Part p = passes::draw(seed);
  Draw d(seed * 41 + 7);
  p.passes.clear();
  const double r = p.radius_m;
  int line = 2;
  for (int pair = 0; pair < 3; ++pair) {
    const double y = 10 * r * pair, depth = r * d.between(0.15, 0.5);
    const double aside = r * d.between(0.2, 1.2), side = d.chance(0.5) ? 1 : -1;
    p.passes.push_back({y, depth, {}, line += 5});
    p.passes.push_back({y + side * aside, depth, {}, line += 5});
  }
  return p;
}
/// What is left before each pass, by the radius that the passes before were cut with.
void leave(Part& p) {
  const double r = p.radius_m;
  for (std::size_t i = 0; i < p.passes.size(); ++i) {
    std::array<double, 2> left = {-r, r};
    if (i % 2 == 1) {
      const double aside = p.passes[i].y_m - p.passes[i - 1].y_m;
      left = aside > 0 ? std::array{std::max(-r, r - aside), r}
                       : std::array{-r, std::min(r, -r - aside)};
    }
    p.passes[i].uncut_m = {left, left};
  }
}
/// The same program with another tool: the feed of the axes stays.
Part with_tool(Part p, std::size_t teeth, double radius_m, double runout, Draw& d) {
  const double per_turn = p.feed_m * static_cast<double>(p.teeth());
  p.radius_m = radius_m;
  p.feed_m = per_turn / static_cast<double>(teeth);
  p.pitch.clear();
  p.runout_m.clear();
  for (std::size_t i = 0; i < teeth; ++i) {
    p.pitch.push_back(kTwoPi * (static_cast<double>(i) + d.between(-0.02, 0.02)) /
                      static_cast<double>(teeth));
    p.runout_m.push_back(p.feed_m * d.between(-runout, runout));
  }
  leave(p);
  return p;
}

Said said(const std::string& reason) {
  if (contains(reason, "do not tell which")) return open;
  if (contains(reason, "pulses as that of")) return counted;
  if (contains(reason, "larger diameter")) return larger;
  if (contains(reason, "smaller diameter")) return smaller;
  if (contains(reason, "worn tool") || contains(reason, "softer material")) return every;
  if (contains(reason, "stock that is too high")) return too_high;
  if (contains(reason, "stock that is too low")) return too_low;
  if (contains(reason, "in this place alone")) return here;
  return nothing;
}
constexpr std::array<Said, kKinds> kTruth = {silent, silent, counted,  larger,  smaller,
                                             every,  every,  too_high, too_low, here};
const char* words_of(Said truth) {
  return truth == larger     ? "larger diameter"
         : truth == smaller  ? "smaller diameter"
         : truth == every    ? "worn tool"
         : truth == too_high ? "stock that is too high"
         : truth == too_low  ? "stock that is too low"
                             : "in this place alone";
}

void watch(Kind kind, const Part& cut, const Course& c, const StackPlan& plan, std::uint64_t seed) {
  static auto stack = std::make_unique<HostStack>();
  prepare(*stack, plan);
  std::string last;
  bool above = false;
  for (const auto& sample : passes::simulate(cut, c).samples)
    for (const auto& change : stack->process(sample)) {
      if (change.state != MonitorState::alarm || change.monitor != MonitorId::torque_band) continue;
      last = event_from(change, 0).reason;
      above = above || contains(last, "upwards");
    }
  Row& row = rows[kind];
  ++row.runs;
  const Said verdict = last.empty() ? silent : said(last);
  ++row.last[verdict];
  if (!last.empty()) ++(above ? row.above : row.below);
  if (verdict == counted)
    row.right_count += contains(last, " " + std::to_string(cut.teeth()) + " t") ? 1 : 0;
  if (verdict == open) row.leaves_it_open += contains(last, words_of(kTruth[kind])) ? 1 : 0;
  if (verdict != kTruth[kind])
    std::printf("  seed %llu, %s: %s\n", static_cast<unsigned long long>(seed), kNames[kind],
                last.empty() ? "silent" : last.c_str());
}

void part(std::uint64_t seed) {
  Part p = draw(seed);
  leave(p);
  MachineFile machine = passes::learned(p);
  // Other monitors have studies of their own.
  for (const char* section : {"monitor.chatter", "monitor.ar-breakage", "monitor.tooth-breakage",
                              "monitor.collision", "monitor.cutting-coefficients"})
    machine.remove_section(section);
  machine.set("monitor.torque-band", "reference", "steps.csv");
  put("machine.ini", machine.text());
  put("part.ngc", passes::program_of(p));
  fs::remove(folder / "steps.csv");
  char stock[160];
  const double r = p.radius_m;
  std::snprintf(stock, sizeof stock, " --stock box:0,%.5f,%.5f,%.5f,%.5f,0", -5 * r, -r,
                passes::kBlock_m, 25 * r);
  const Outcome o =
      run("program predict part.ngc --machine machine.ini --stock-tolerance 0.0001 --quiet --out "
          "steps.csv" +
          std::string(stock));
  that(o.status == 0, o, "is predicted", __LINE__);
  machine.set("monitor.torque-band", "reference", (folder / "steps.csv").string());
  const StackPlan plan = detection::second::plan_for(machine);
  double least_m = 1;
  for (const passes::Pass& pass : p.passes) least_m = std::min(least_m, pass.depth_m);
  Draw d(seed * 53 + 11);
  for (int k = 0; k < kKinds; ++k) {
    const auto kind = static_cast<Kind>(k);
    Course c;
    c.harder = d.between(0.93, 1.07);
    c.stock_m = d.between(-0.08e-3, 0.08e-3);
    if (d.chance(0.3)) c.slower_from_s = d.between(2, 15), c.slower = d.between(0.7, 1.1);
    std::size_t n = p.teeth();
    if (kind == teeth)
      while (n == p.teeth()) n = static_cast<std::size_t>(d.whole(1, 6));
    const double as_wide = kind == wider      ? d.between(1.25, 1.6)
                           : kind == narrower ? d.between(0.6, 0.8)
                                              : 1;
    // The sharpest run-out of a new tool: a tenth of the feed to either side, as in the others.
    Part cut = with_tool(p, n, r * as_wide, kind == runout ? d.between(0.3, 0.5) : 0.1, d);
    if (kind == worn) c.harder *= d.between(1.3, 1.6);
    if (kind == blunt) cut.edge_t *= d.between(3, 6), cut.edge_r *= 4;
    if (kind == high) c.stock_m += least_m * d.between(0.4, 1);
    if (kind == low) c.stock_m -= least_m * d.between(0.4, 0.7);
    if (kind == one_pass)
      cut.passes[static_cast<std::size_t>(d.whole(1, 5))].depth_m *= d.between(1.5, 2);
    watch(kind, cut, c, plan, seed);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  const check::SeedRange seeds = check::seed_range(
      argc, argv, nightly ? check::SeedRange{974001, 12} : check::SeedRange{1, 1});
  return in_own_folder("wrong_tool", [&] {
    for (std::uint64_t seed = seeds.from; seed < seeds.from + seeds.cases; ++seed) part(seed);
    for (int k = 0; k < kKinds; ++k) {
      const Row& row = rows[static_cast<std::size_t>(k)];
      std::printf("  %-46s of %3d:", kNames[static_cast<std::size_t>(k)], row.runs);
      for (std::size_t s = 0; s < kSaid; ++s)
        if (row.last[s] > 0) std::printf(" %s %d,", kSays[s], row.last[s]);
      std::printf(" right count %d, truth left open %d; above %d, below %d\n", row.right_count,
                  row.leaves_it_open, row.above, row.below);
    }
    int told = 0, right = 0;
    for (const Kind kind : {wider, narrower, worn, blunt, high, low, one_pass}) {
      const Row& row = rows[kind];
      for (const Said s : {counted, larger, smaller, every, too_high, too_low, here})
        told += row.last[s];
      right += row.last[kTruth[kind]];
    }
    std::printf("  told of the courses: %d, of these right %d\n", told, right);
    CHECK(rows[sound].last[silent] == rows[sound].runs);
    // What is reached: run-out of the whole feed leaves one tooth of two to cut.
    CHECK(10 * rows[runout].last[counted] <= rows[runout].runs);
    CHECK(rows[teeth].right_count == rows[teeth].last[counted]);
    CHECK(10 * right >= 9 * told);
    if (nightly) CHECK(4 * rows[teeth].right_count >= 3 * rows[teeth].runs);
  });
}
