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
#include <memory>
#include <string>
#include <vector>

#include "chatter_advice.hpp"
#include "check.hpp"
#include "detection/random_cuts.hpp"
#include "detection/scores.hpp"
#include "detection/tapped_file.hpp"
#include "development_seeds.hpp"
#include "servosense/hal/linuxcnc_link.hpp"
#include "servosense/hal/override_request.hpp"
#include "servosense/hal/stop_request.hpp"
#include "servosense/monitors/override_control.hpp"

using namespace detection;
using cli::ChatterAdvice;
using detection::Event;

namespace {

constexpr std::uint64_t kFirstSeed = 840000;
constexpr double kCut_s = 4;                     // at full engagement
constexpr double kAdviceAfter_s = 0.1;           // the alarm: what it takes to look for pockets
constexpr double kQuiet_s = 1;                   // after the alarm, as it is asked for
constexpr double kStill = 0.2, kChatters = 0.3;  // feeds per tooth, as in docs/detection.md
constexpr double kHeld_s = 1;                    // watched after a hold
constexpr double kFalse_s = 0.3;                 // a false alarm lasts

enum class Rule { none, loop, with_variation, half_feed };
constexpr std::array kRules = {Rule::loop, Rule::with_variation, Rule::half_feed};
constexpr const char* kRuleNames[] = {"nothing", "loop", "loop with variation", "half feed"};

OverrideConfig limits(Rule rule) {
  OverrideConfig c;
  c.sample_period_s = kPeriod_s;
  c.least_speed = 0.6;
  c.greatest_speed = 1.5;
  c.least_feed = 0.5;
  c.greatest_feed = 1.1;
  c.speed_rate_per_s = c.feed_rate_per_s = 1;
  c.variation_amplitude = rule == Rule::with_variation ? 0.1 : 0;
  c.variation_hz = 1.5;
  return c;
}

struct Outcome {
  bool alarmed = false, held = false, finished = false, lost = false, commanded = false;
  OverridePhase last = OverridePhase::programmed;
  double alarm_s = kNever, hold_s = kNever, end_s = 0;
  double after = 0;   ///< largest vibration from kQuiet_s after the alarm on, in feeds per tooth
  double steady = 0;  ///< largest vibration at full engagement, likewise
};

Cut lengthened(Cut c) {
  c.simulation.program.cut_s = c.entry_s + kCut_s;
  return c;
}

/// What comes between what is commanded and the machine.
using Through = std::function<MachineOverride(double t_s, const MachineOverride&)>;

/// `false_at_s`: an alarm that is none, so long after full engagement.
Outcome run(const Cut& c, const StackPlan& plan, const ChatterAdvice& advice, Rule rule,
            double false_at_s = kNever, const Through& through = {}) {
  MachineSimulator machine = good(MachineSimulator::create(c.simulation), c.text.c_str());
  auto stack = std::make_unique<HostStack>();
  stack->configure(plan.config);
  OverrideControl<double> control;
  const OverrideConfig config = limits(rule);
  const Status valid = OverrideControl<double>::validate(config);
  CHECK(valid.ok());
  control.configure(config);
  OverrideInput<double> in;
  Record r;
  r.schedule = machine.schedule();
  Reporter<double> reporter(c, r, c.seed + 1);
  Outcome o;
  const double full_s = r.schedule.contact_s + c.entry_s;
  double advice_s = kNever;
  bool alarm = false, asked = false;
  const auto most = static_cast<std::size_t>(3 * r.schedule.run_down_s / kPeriod_s);
  for (std::size_t i = 0; i < most && machine.program_s() < r.schedule.run_down_s; ++i) {
    const MachineSample s = machine.step();
    r.drive[0].add(*s.spindle);
    r.drive[1].add(*s.x);
    r.drive[2].add(*s.y);
    r.torque_Nm.push_back(static_cast<float>(s.cut.torque_Nm));
    r.x_m.push_back(static_cast<float>(s.cut.x_m));
    r.y_m.push_back(static_cast<float>(s.cut.y_m));
    if (machine.milling().lost()) {
      o.lost = true;
      break;
    }
    for (const auto& change : stack->process(reporter.at(i)))
      if (change.monitor == MonitorId::chatter && change.detail == 0)
        alarm = change.state == MonitorState::alarm;
    const double since = s.t_s - full_s - false_at_s;
    in.chatter = alarm || (since >= 0 && since < kFalse_s);
    if (in.chatter && o.alarm_s == kNever) o.alarm_s = s.t_s;
    in.in_cut = stack->cut().state().cut == CutPresence::cutting;
    MachineOverride set;
    if (rule == Rule::half_feed) {
      set.feed = in.chatter ? 0.5 : 1;
      o.commanded = o.commanded || in.chatter;
    } else if (rule != Rule::none) {
      if (in.chatter && control.state().phase == OverridePhase::programmed && advice_s == kNever &&
          !asked)
        advice_s = s.t_s + kAdviceAfter_s;
      if (s.t_s >= advice_s) {
        asked = true;
        advice_s = kNever;
        const double rpm = rpm_from_rad_s(machine.spindle_reference(machine.program_s()));
        // The faster one first: it costs no time, and pockets widen with the speed.
        auto speeds =
            advice.advised_speeds(rpm, config.least_speed * rpm, config.greatest_speed * rpm).rpm;
        std::reverse(speeds.begin(), speeds.end());
        for (std::size_t k = 0; k < speeds.size() && k < 2; ++k) in.advised[k] = speeds[k] / rpm;
      }
      in.advice_pending = s.t_s < advice_s && advice_s < kNever;
      const auto& said = control.process(in);
      set = {said.speed_ratio, said.feed_ratio, said.hold};
      if (said.phase != OverridePhase::programmed) o.last = said.phase;
      o.commanded = o.commanded || said.phase != OverridePhase::programmed || said.hold;
      if (said.hold && o.hold_s == kNever) o.hold_s = s.t_s;
      if (s.t_s >= o.hold_s + kHeld_s) break;
    }
    machine.set(through ? through(s.t_s, set) : set);
  }
  o.alarmed = o.alarm_s < kNever;
  o.held = o.hold_s < kNever;
  o.finished = !o.held && !o.lost && machine.program_s() >= r.schedule.run_down_s;
  o.end_s = static_cast<double>(r.size()) * kPeriod_s;
  std::vector<double> unlike_Nm2;
  detection::detail::find_vibration(c, r, unlike_Nm2);
  const double feed = c.milling().cut.feed_per_tooth_m;
  const double stop_s =
      o.finished ? o.end_s - (r.schedule.run_down_s - r.schedule.stop_s) : o.end_s;
  for (std::size_t i = 0; i < r.size(); ++i) {
    const double t = static_cast<double>(i) * kPeriod_s;
    const double v = static_cast<double>(r.vibration_m[i]) / feed;
    if (t > full_s + 4 * c.turn_s() && t < stop_s) o.steady = std::max(o.steady, v);
    if (t > o.alarm_s + kQuiet_s && t < stop_s) o.after = std::max(o.after, v);
  }
  if (o.lost) o.after = HUGE_VAL;
  return o;
}

// Monitors, block, link, LinuxCNC and back to the cut.
int through_linuxcnc(const char* url) {
  constexpr std::uint64_t kSeed = 742000;  // has a pocket
  constexpr double kTick_s = 0.005;        // at which the simulation waits for the clock
  const Cut c = lengthened(draw(kSeed, Event::chatter, Feature::none));
  const StackPlan plan = good(plan_stack(learn(c, idle_run(c)), signals()), c.text.c_str());
  const MachineFile file = file_of(c);
  const ChatterAdvice advice(file, plan);
  const Outcome idle = run(c, plan, advice, Rule::none);
  CHECK(idle.alarmed && idle.steady > kChatters);
  LinuxCncLink link(good(linuxcnc_config(url), "address"));
  CHECK(link.connect() == CncReply::done);
  OverrideRequest overrides(link);
  StopRequest stop(link, {}, {}, [&] { return overrides.turn(); });
  stop.start();
  const Nanoseconds began = link.now_ns();
  double next_s = 0, late_s = 0, least = 1, greatest = 1;
  bool held = false;
  const Outcome o =
      run(c, plan, advice, Rule::loop, kNever, [&](double t_s, const MachineOverride& set) {
        overrides.set(set.speed, set.feed);
        if (set.hold && !held) stop.raise(link.now_ns());
        held = set.hold;
        if (t_s >= next_s) {
          next_s += kTick_s;
          const double ahead = t_s - seconds_from(link.now_ns() - began);
          late_s = std::max(late_s, -ahead);
          if (ahead > 0) link.wait(ahead);
        }
        const OverrideHealth h = overrides.health();
        least = std::min(least, h.speed);
        greatest = std::max(greatest, h.speed);
        return MachineOverride{h.speed, h.feed, stop.health().holding};
      });
  stop.stop();
  CHECK(overrides.give_back());
  CncOverrides last;
  CHECK(link.overrides(last) == CncReply::done && last.feed == 1 && last.spindle == 1);
  const OverrideHealth h = overrides.health();
  std::printf(
      "  through LinuxCNC, seed %llu: alone %.2f feeds per tooth, from 1 s after the alarm %.2f; "
      "%s; spindle %.0f to %.0f %%, %llu commands acknowledged, %llu takeovers; the simulation "
      "was up to %.2f s behind the clock\n",
      static_cast<unsigned long long>(kSeed), idle.after, o.after,
      o.finished ? "the cut is finished" : "held", 100 * least, 100 * greatest,
      static_cast<unsigned long long>(h.commands), static_cast<unsigned long long>(h.takeovers),
      late_s);
  CHECK(o.finished && o.after < kStill && idle.after > kChatters);
  CHECK(h.commands > 0 && h.takeovers == 0 && h.refused == 0);
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
    const Outcome idle = run(c, plan, advice, Rule::none);
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
      const Outcome o = run(c, plan, advice, rule);
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
    const Outcome idle = run(c, plan, advice, Rule::none);
    if (idle.steady > kStill) continue;  // by the truth it is none
    ++sound;
    commanded += run(c, plan, advice, Rule::loop).commanded;
    const Outcome cry = run(c, plan, advice, Rule::loop, 1);
    const Outcome half = run(c, plan, advice, Rule::half_feed, 1);
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
