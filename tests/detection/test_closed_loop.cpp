// The loop closed on simulated machines: random cuts between their drives, watched by the monitors
// as they are, with the overrides that OverrideControl commands. Beside it the naive rule, half the
// feed while the chatter alarm stands, and nothing at all.
//
//   closed_loop             a few cuts
//   closed_loop --nightly   120
//   closed_loop --cases N [--from SEED] [--development]
//
// With SERVOSENSE_LINUXCNC=linuxcnc://HOST:PORT (tests/linuxcnc/cnc.sh starts one) a cut of the
// development seeds through LinuxCNC: its overrides, as it acknowledges them, are those of the
// simulated machine, which keeps to the clock.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include "check.hpp"
#include "detection/closed_loop.hpp"
#include "detection/random_cuts.hpp"
#include "detection/scores.hpp"
#include "detection/tapped_file.hpp"
#include "detection/through_linuxcnc.hpp"
#include "development_seeds.hpp"

using namespace detection;
using detection::Event;

namespace {

constexpr std::uint64_t kFirstSeed = 840000;
constexpr double kCut_s = 4;                     // at full engagement
constexpr double kStill = 0.2, kChatters = 0.3;  // feeds per tooth, as in docs/detection.md

constexpr std::array kRules = {Rule::loop, Rule::with_variation, Rule::half_feed};

Cut lengthened(Cut c) {
  c.simulation.program.cut_s = c.entry_s + kCut_s;
  return c;
}

// Monitors, block, link, LinuxCNC and back to the cut.
int through_linuxcnc(const char* url) {
  constexpr std::uint64_t kSeed = 742000;  // has a pocket
  const Cut c = lengthened(draw(kSeed, Event::chatter, Feature::none));
  const StackPlan plan = good(plan_stack(learn(c, idle_run(c)), signals()), c.text.c_str());
  const MachineFile file = file_of(c);
  const ChatterAdvice advice(file, plan);
  const LoopOutcome idle = run_loop(c, plan, advice, {});
  CHECK(idle.alarmed && idle.steady > kChatters);
  ThroughLinuxCnc cnc(url);
  const LoopOutcome o = run_loop(c, plan, advice, {.rule = Rule::loop, .through = std::ref(cnc)});
  cnc.end();
  const OverrideHealth h = cnc.health();
  std::printf(
      "  through LinuxCNC, seed %llu: alone %.2f feeds per tooth, from 1 s after the alarm %.2f; "
      "%s; spindle %.0f to %.0f %%, %llu commands acknowledged; the simulation was up to %.2f s "
      "behind the clock\n",
      static_cast<unsigned long long>(kSeed), idle.after, o.after,
      o.finished ? "the cut is finished" : "held", 100 * cnc.least().speed,
      100 * cnc.greatest().speed, static_cast<unsigned long long>(h.commands), cnc.late_s());
  CHECK(o.finished && o.after < kStill && idle.after > kChatters);
  CHECK(h.commands > 0);
  return check::done();
}

}  // namespace

int main(int argc, char** argv) {
  if (const char* url = std::getenv("SERVOSENSE_LINUXCNC")) return through_linuxcnc(url);
  std::size_t cases = 3;
  std::uint64_t from = kFirstSeed;
  bool nightly = check::nightly(argc, argv), development = false;
  if (nightly) cases = 120;
  for (int i = 1; i < argc; ++i) {
    const std::string option = argv[i];
    const char* value = i + 1 < argc ? argv[i + 1] : "0";
    if (option == "--cases") cases = std::strtoul(value, nullptr, 10);
    if (option == "--from") from = std::strtoul(value, nullptr, 10);
    if (option == "--development") development = true;
  }
  if (const char* use = development::use_of(development::kDetection, from, cases);
      use != nullptr && !development) {
    std::printf("  these seeds were used before (%s); --development scores them all the same\n",
                use);
    return 2;
  }
  struct Sum {
    int quiet = 0, quiet_finished = 0, held_quiet = 0, finished = 0, cuts = 0;
    int by_speed = 0, by_variation = 0;
    double longer = 0;  // of the finished ones, sum of shares
  } sums[4];
  int chattering = 0, with_pocket = 0;
  for (std::size_t n = 0; n < cases; ++n) {
    const Cut c = lengthened(draw(from + n, Event::chatter, Feature::none));
    const StackPlan plan = good(plan_stack(learn(c, idle_run(c)), signals()), c.text.c_str());
    const MachineFile file = file_of(c);
    const ChatterAdvice advice(file, plan);
    const LoopOutcome idle = run_loop(c, plan, advice, {});
    // Without an alarm there is nothing to judge, nor where nothing vibrates.
    if (!idle.alarmed || !(idle.steady > kChatters || idle.lost)) continue;
    ++chattering;
    const double rpm = c.milling().cut.spindle_speed_rpm;
    const OverrideConfig user = limits(Rule::loop);
    const bool pocket =
        !advice.advised_speeds(rpm, user.least_speed * rpm, user.greatest_speed * rpm).rpm.empty();
    with_pocket += pocket;
    std::string line;
    for (const Rule rule : kRules) {
      const LoopOutcome o = run_loop(c, plan, advice, {.rule = rule});
      Sum& sum = sums[static_cast<int>(rule)];
      ++sum.cuts;
      const bool quiet = o.after < kStill;
      sum.quiet += quiet;
      sum.finished += o.finished;
      sum.quiet_finished += quiet && o.finished;
      sum.held_quiet += quiet && o.held;
      sum.by_speed += quiet && o.finished && o.last == OverridePhase::advised;
      sum.by_variation += quiet && o.finished && o.last == OverridePhase::varying;
      if (o.finished) sum.longer += o.end_s / idle.end_s - 1;
      char text[200];
      std::snprintf(text, sizeof text, "; %s: %s%s%s %.2f fz, %.2f s",
                    kRuleNames[static_cast<int>(rule)], name_of(o.last),
                    o.held       ? " held"
                    : o.finished ? " finished"
                                 : " lost",
                    quiet ? " quiet" : "", o.after, o.held ? o.hold_s - o.alarm_s : 0);
      line += text;
    }
    std::printf("  seed %llu, %s, alone %.2f fz%s\n", static_cast<unsigned long long>(from + n),
                pocket ? "pocket" : "none", idle.after, line.c_str());
  }
  std::printf("  chattering cuts with an alarm: %d, %d with a pocket inside the limits\n",
              chattering, with_pocket);
  for (const Rule rule : kRules) {
    const Sum& s = sums[static_cast<int>(rule)];
    std::printf(
        "  %-24s quiet within 1 s %3d of %d: %d cut on (%d at an advised speed, %d by variation), "
        "%d held; finished %d, %.1f %% longer\n",
        kRuleNames[static_cast<int>(rule)], s.quiet, s.cuts, s.quiet_finished, s.by_speed,
        s.by_variation, s.held_quiet, s.finished, 100 * s.longer / std::max(1, s.finished));
  }
  // Sound cuts: what is commanded of itself, and what one false alarm costs.
  int sound = 0, commanded = 0, held = 0;
  double worst = 0, total = 0, worst_half = 0;
  for (std::size_t n = 0; n < cases; ++n) {
    const Cut c = lengthened(draw(from + n, Event::none, Feature::none));
    const StackPlan plan = good(plan_stack(learn(c, idle_run(c)), signals()), c.text.c_str());
    const MachineFile file = file_of(c);
    const ChatterAdvice advice(file, plan);
    const LoopOutcome idle = run_loop(c, plan, advice, {});
    if (idle.steady > kStill) continue;  // by the truth it is none
    ++sound;
    commanded += run_loop(c, plan, advice, {.rule = Rule::loop}).commanded;
    const LoopOutcome cry = run_loop(c, plan, advice, {.rule = Rule::loop, .false_at_s = 1});
    const LoopOutcome half = run_loop(c, plan, advice, {.rule = Rule::half_feed, .false_at_s = 1});
    held += cry.held;
    if (cry.end_s / idle.end_s > 1.02)
      std::printf("  seed %llu: a false alarm costs %.1f %%, %s\n",
                  static_cast<unsigned long long>(from + n), 100 * (cry.end_s / idle.end_s - 1),
                  name_of(cry.last));
    const double cost = cry.end_s / idle.end_s - 1;
    worst = std::max(worst, cost);
    total += cost;
    worst_half = std::max(worst_half, half.end_s / idle.end_s - 1);
  }
  std::printf("  sound cuts: %d, with a command %d\n", sound, commanded);
  std::printf(
      "  a false alarm of 0.3 s in a cut of 4 s: %.2f %% longer in the mean, %.2f %% at most, held "
      "%d; half feed %.2f %% at most\n",
      100 * total / std::max(1, sound), 100 * worst, held, 100 * worst_half);
  const Sum& loop = sums[static_cast<int>(Rule::loop)];
  const Sum& half = sums[static_cast<int>(Rule::half_feed)];
  CHECK(chattering > 0 && sound > 0);
  CHECK(10 * loop.by_speed >= 8 * with_pocket);
  CHECK(2 * half.quiet <= loop.quiet);
  CHECK(total <= 0.02 * sound);
  if (nightly) {
    CHECK(2 * loop.quiet >= chattering);
    CHECK(20 * commanded <= sound);
  }
  return check::done();
}
