// The loop closed on simulated machines, second half: overload to less feed, collision to a feed
// hold. All alarms are heard at once, as `monitor --cnc` hears them.
//
//   closed_loop_feed             a few of each
//   closed_loop_feed --nightly   40
//   closed_loop_feed --cases N [--from SEED] [--development]
//
// Overload: the cut of a seed with a pocket along one side before it and behind it, so that the
// stock is as wide as drawn for 1.5 to 2.5 s alone; or a wedge, which reaches the drawn depth at
// its end. The user's limit is what the full cut asks for over a drawn 1.15 to 1.9, and the mean
// torque over a revolution, by the simulated cut itself, is held against it. Collision: what is in
// the way does not give way. Sound cuts, with all their features, under a limit 1.1 to 1.5 times
// the highest of these means.
//
// With SERVOSENSE_LINUXCNC=linuxcnc://HOST:PORT (tests/linuxcnc/cnc.sh starts one) an overload and
// a collision of the development seeds go through LinuxCNC.
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
#include "detection/scores.hpp"
#include "detection/tapped_file.hpp"
#include "detection/through_linuxcnc.hpp"
#include "development_seeds.hpp"
#include "seed_range.hpp"

using namespace detection;
using detection::Event;
using detection::detail::Draw;

namespace {

constexpr std::uint64_t kFirstSeed = 841000;
constexpr double kAfter_s = 1;   // the limit was passed: by then less feed has done what it can
constexpr double kTaught = 1.5;  // of the highest force of a good part: the limit of the rival

/// A program that was taught by a good part, and what its user sets.
struct Case {
  Cut cut;
  StackPlan plan;
  MachineFile file;
  double taught_N = 0;  ///< highest force of the motor of x in the good part

  explicit Case(Cut c) : cut(std::move(c)), file(file_of(cut)) {
    MachineFile machine = learn(cut, idle_run(cut));
    (void)learn_good_cut(cut, machine);
    plan = good(plan_stack(machine, signals()), cut.text.c_str());
    const Cut part = good_part(cut);
    const double newton_per_A = part.simulation.x->effort_per_A;
    (void)run_loop(part, plan, ChatterAdvice(file, plan),
                   {.watch = [&](const MachineSample& s, const HostStack&, const MachineOverride&) {
                     taught_N = std::max(taught_N, std::abs(s.x->current_A) * newton_per_A);
                   }});
  }
  [[nodiscard]] LoopOutcome run(LoopOptions options) const {
    options.collision = true;
    options.force_limit_N = kTaught * taught_N;
    return run_loop(cut, plan, ChatterAdvice(file, plan), options);
  }
};

/// Mean torque of the cut over a revolution, against a limit.
class Loading {
 public:
  Loading(const Cut& c, double limit_Nm)
      : last_(static_cast<std::size_t>(std::lround(c.turn_s() / kPeriod_s)), 0.0),
        limit_Nm_(limit_Nm) {}
  void add(double t_s, double torque_Nm) {
    double& oldest = last_[at_];
    sum_Nm_ += torque_Nm - oldest;
    oldest = torque_Nm;
    at_ = (at_ + 1) % last_.size();
    const double mean = sum_Nm_ / static_cast<double>(last_.size());
    highest_Nm = std::max(highest_Nm, mean);
    if (!(limit_Nm_ > 0)) return;
    means_Nm.push_back(mean);
    const double load = mean / limit_Nm_;
    if (load > 1) {
      above_s += kPeriod_s;
      first_s = std::min(first_s, t_s);
    }
    if (t_s > first_s + kAfter_s) after = std::max(after, load);
    if (!above_ && load > 1.02) ++passes;
    above_ = above_ ? load > 1 : load > 1.02;
  }
  double highest_Nm = 0;
  double above_s = 0, first_s = kNever;
  double after = 0;  ///< largest load from kAfter_s after the first above 1 on
  int passes = 0;    ///< above the limit by 2 %, and below it between them
  std::vector<double> means_Nm;

 private:
  std::vector<double> last_;
  std::size_t at_ = 0;
  double sum_Nm_ = 0, limit_Nm_;
  bool above_ = false;
};

/// Of the program as it is.
double highest_mean_Nm(const Case& of) {
  Loading load(of.cut, 0);
  (void)of.run({.watch = [&](const MachineSample& s, const HostStack&, const MachineOverride&) {
    load.add(s.t_s, s.cut.torque_Nm);
  }});
  return load.highest_Nm;
}

/// Stock that asks for `part` of the full torque but for a stretch, or grows to it.
Cut overloaded(Cut c, Draw& d, double part, bool wedge) {
  MillingSimulation& m = c.simulation.milling;
  const double feed = m.cut.feed_per_tooth_m * m.tool.teeth / c.turn_s();
  if (wedge) {
    constexpr double kGrows_s = 4;
    c.simulation.program.cut_s = c.entry_s + kGrows_s;
    m.workpiece.length_m = feed * (kGrows_s + 0.2);
    m.workpiece.front_depth_m = part * m.cut.axial_depth_m;
    m.workpiece.far_depth_m = m.cut.axial_depth_m;
    return c;
  }
  const Engagement window = engagement_of(m.tool, m.cut);
  const double one = m.tool.radius_m() * std::cos(window.start_rad),
               other = m.tool.radius_m() * std::cos(window.exit_rad);
  const double removed = (1 - part) * std::abs(one - other);
  const double hole = removed * d.between(1, 4);
  const bool upper = d.chance(0.5);
  const double y =
      upper ? std::max(one, other) + hole - removed : std::min(one, other) - hole + removed;
  // Where a hole reaches the edge of the cut, from its middle on.
  const double chord = std::sqrt(hole * hole - (hole - removed) * (hole - removed));
  const double first_m = feed;  // the end of the first row of holes, and the start of the second
  const double second_m = first_m + 2 * chord + feed * d.between(1.5, 2.5);
  const double end_m = second_m + 3 * feed;
  const double pitch = chord / 8;  // ridges of hole / 512 at most
  for (double x = first_m; x > -2 * m.tool.radius_m(); x -= pitch)
    m.workpiece.holes.push_back({x, y, hole});
  for (double x = second_m; x < end_m + 2 * m.tool.radius_m(); x += pitch)
    m.workpiece.holes.push_back({x, y, hole});
  c.simulation.program.cut_s = c.entry_s + end_m / feed;
  return c;
}

/// What the feed could do at best: somebody who knows the torque beforehand, edge forces included.
double least_longer_s(const std::vector<double>& means_Nm, double limit_Nm, double edge) {
  double longer = 0;
  for (const double mean : means_Nm) {
    if (!(mean > limit_Nm)) continue;
    const double feed =
        std::max(limits(Rule::loop).least_feed, (limit_Nm / mean - edge) / (1 - edge));
    longer += (1 / feed - 1) * kPeriod_s;
  }
  return longer;
}

struct OverloadSum {
  int cuts = 0, finished = 0, held = 0, passes = 0, below = 0, back = 0, steps = 0;
  double longer = 0;  // of the finished ones, sum of shares
  std::vector<double> above_s, after;
};

void print(const char* name, const OverloadSum& s) {
  std::printf(
      "    %-16s finished %2d of %2d, held %2d; limit passed %3d times, %.2f s above it in the "
      "median, %.2f s at most; from 1 s after the first time on at %.2f of it in the median, %.2f "
      "at most, below 1.02 in %d; longer %.1f %% in the mean; feed back at its end %d of %d\n",
      name, s.finished, s.cuts, s.held, s.passes, quantile(s.above_s, 0.5), quantile(s.above_s, 1),
      quantile(s.after, 0.5), quantile(s.after, 1), s.below,
      100 * s.longer / std::max(1, s.finished), s.back, s.steps);
}

constexpr std::array kOverloadRules = {Rule::none, Rule::loop, Rule::half_feed, Rule::hold};

struct Overload {
  double over = 0;  ///< what the full cut asks for, of the limit
  bool wedge = false;
  Case of;
  double limit_Nm = 0;
  double edge = 0;         ///< share of its torque that no feed changes
  bool reducible = false;  ///< the least feed is little enough

  explicit Overload(std::uint64_t seed) : Overload(seed, Draw(seed + 11'000'000)) {}

 private:
  Overload(std::uint64_t seed, Draw d)
      : over(d.between(1.15, 1.9)),
        wedge(seed % 2 == 1),
        of(overloaded(draw(seed, Event::none, Feature::none), d, d.between(0.55, 0.85) / over,
                      wedge)) {
    const double full_Nm = highest_mean_Nm(of);
    limit_Nm = full_Nm / over;
    edge = std::clamp(1 - of.cut.mean_torque_Nm / full_Nm, 0.0, 0.9);
    reducible = over * (edge + limits(Rule::loop).least_feed * (1 - edge)) <= 1;
  }
};

void overloads(std::uint64_t from, std::uint64_t cases, OverloadSum (&sums)[2][8]) {
  double best[2]{};
  int count[2]{};
  for (std::uint64_t seed = from; seed < from + cases; ++seed) {
    const Overload o(seed);
    std::string line;
    double alone_s = 0;
    for (const Rule rule : kOverloadRules) {
      Loading load(o.of.cut, o.limit_Nm);
      double feed = 1;
      LoopOptions options{.rule = rule, .torque_limit_Nm = o.limit_Nm};
      options.watch = [&](const MachineSample& s, const HostStack&, const MachineOverride& set) {
        load.add(s.t_s, s.cut.torque_Nm);
        if (s.cut.torque_Nm > 0) feed = set.feed;
      };
      const LoopOutcome out = o.of.run(options);
      if (rule == Rule::none) {
        alone_s = out.end_s;
        best[o.reducible] += least_longer_s(load.means_Nm, o.limit_Nm, o.edge) / alone_s;
        ++count[o.reducible];
      }
      OverloadSum& s = sums[o.reducible][static_cast<int>(rule)];
      ++s.cuts;
      s.finished += out.finished;
      s.held += out.held;
      s.passes += load.passes;
      s.above_s.push_back(load.above_s);
      s.after.push_back(load.after);
      s.below += load.after <= 1.02;
      if (out.finished) s.longer += out.end_s / alone_s - 1;
      if (!o.wedge) {
        ++s.steps;
        s.back += out.finished && feed == 1;
      }
      char text[160];
      std::snprintf(text, sizeof text, "; %s%s%s %d times %.2f s, then %.2f, %.1f %%",
                    kRuleNames[static_cast<int>(rule)], out.held ? " held" : "",
                    out.collided  ? " COLLIDED"
                    : out.alarmed ? " chatter"
                                  : "",
                    load.passes, load.above_s, load.after, 100 * (out.end_s / alone_s - 1));
      line += text;
    }
    std::printf("  seed %llu %s %.2f of the limit, edge %.2f%s%s\n",
                static_cast<unsigned long long>(seed), o.wedge ? "wedge" : "step", o.over, o.edge,
                o.reducible ? "" : ", too much for the least feed", line.c_str());
  }
  for (const int r : {1, 0}) {
    std::printf("  overload %s, %d cuts; who knows the torque takes %.1f %% longer\n",
                r ? "that less feed can end" : "that it cannot", count[r],
                100 * best[r] / std::max(1, count[r]));
    for (const Rule rule : kOverloadRules)
      print(kRuleNames[static_cast<int>(rule)], sums[r][static_cast<int>(rule)]);
  }
}

struct SoundSum {
  int cuts = 0, overloaded = 0, held = 0, commanded = 0, by_peak = 0, by_motor = 0, by_current = 0;
};

SoundSum sound_cuts(std::uint64_t from, std::uint64_t cases) {
  SoundSum sum;
  for (std::uint64_t seed = from; seed < from + cases; ++seed) {
    const Case of(draw(seed, Event::none));
    Draw d(seed + 12'000'000);
    const double limit_Nm = highest_mean_Nm(of) * d.between(1.1, 1.5);
    const double constant = of.cut.simulation.spindle->effort_per_A;
    const CutSchedule when =
        good(MachineSimulator::create(of.cut.simulation), of.cut.text.c_str()).schedule();
    const double gain = CutDetectorConfig{}.cutoff_rad_s * kPeriod_s;
    double motor_Nm = 0;
    bool peak = false, motor = false;
    const LoopOutcome out = of.run(
        {.rule = Rule::loop,
         .torque_limit_Nm = limit_Nm,
         .watch = [&](const MachineSample& s, const HostStack& stack, const MachineOverride&) {
           motor_Nm += gain * (std::abs(s.spindle->current_A) * constant - motor_Nm);
           if (s.t_s < when.feed_s) return;  // rivals need not hear the run-up
           motor = motor || motor_Nm > limit_Nm;
           peak = peak || std::abs(stack.spindle().estimate) > limit_Nm;
         }});
    const bool current = of.run({.rule = Rule::current_hold}).held;
    ++sum.cuts;
    sum.overloaded += out.overloaded;
    sum.held += out.held;
    sum.commanded += out.commanded;
    sum.by_peak += peak;
    sum.by_motor += motor;
    sum.by_current += current;
    if (out.commanded || motor || current)
      std::printf("  seed %llu sound, %s:%s%s%s%s%s\n", static_cast<unsigned long long>(seed),
                  name_of(of.cut.feature), out.overloaded ? " OVERLOADED" : "",
                  out.held ? " HELD" : "", out.commanded ? " COMMANDED" : "",
                  motor ? " motor torque" : "", current ? " current" : "");
  }
  std::printf(
      "  sound cuts: %d; with a command %d, feed reduced %d, held %d; torque without a filter "
      "above "
      "the limit %d, torque of the motor %d; held by the current of x %d\n",
      sum.cuts, sum.commanded, sum.overloaded, sum.held, sum.by_peak, sum.by_motor, sum.by_current);
  return sum;
}

constexpr std::array kContactRules = {Rule::none, Rule::touch_hold, Rule::loop, Rule::current_hold};

/// From the touch on.
struct Contact {
  double touch_s = kNever, touch_m = 0, way_m = 0, force_N = 0;
  void add(const MachineSample& s) {
    if (s.obstacle_N > 0 && touch_s == kNever) {
      touch_s = s.t_s;
      touch_m = s.x->load_position;
    }
    if (touch_s == kNever) return;
    way_m = std::max(way_m, s.x->load_position - touch_m);
    force_N = std::max(force_N, s.obstacle_N);
  }
};

struct ContactSum {
  int cuts = 0, held = 0, early = 0;
  std::vector<double> after_s, way_m, beyond_m, force_N;  // beyond: the way of Rule::touch_hold
};

void contacts(std::uint64_t from, std::uint64_t cases, ContactSum (&sums)[2][8]) {
  for (std::uint64_t seed = from; seed < from + cases; ++seed) {
    Cut c = draw(seed, Event::collision);
    c.simulation.obstacle->strength_N = HUGE_VAL;
    const Case of(std::move(c));
    std::string line;
    bool air = false;
    double best_m = 0;
    for (const Rule rule : kContactRules) {
      Contact contact;
      LoopOptions options{.rule = rule};
      options.watch = [&](const MachineSample& s, const HostStack&, const MachineOverride&) {
        contact.add(s);
      };
      const LoopOutcome out = of.run(options);
      const CutSchedule when =
          good(MachineSimulator::create(of.cut.simulation), of.cut.text.c_str()).schedule();
      if (rule == Rule::none) air = contact.touch_s < when.contact_s;
      if (rule == Rule::none && contact.touch_s == kNever) {
        line = "; no contact";
        break;
      }
      ContactSum& s = sums[air][static_cast<int>(rule)];
      ++s.cuts;
      const bool early = out.hold_s < contact.touch_s;
      s.early += early;
      s.held += out.held && !early;
      if (!early) {
        if (rule == Rule::touch_hold) best_m = contact.way_m;
        s.way_m.push_back(contact.way_m);
        s.beyond_m.push_back(contact.way_m - best_m);
        s.force_N.push_back(contact.force_N);
        s.after_s.push_back(out.hold_s - contact.touch_s);
      }
      char text[160];
      std::snprintf(text, sizeof text, "; %s %s %.1f ms, %.0f um, %.0f N",
                    kRuleNames[static_cast<int>(rule)], early ? "EARLY" : "",
                    1e3 * (out.hold_s - contact.touch_s), 1e6 * contact.way_m, contact.force_N);
      line += text;
    }
    const MillingSimulation& m = of.cut.milling();
    std::printf("  seed %llu in the %s, %.1f N/um, feed %.1f mm/s, good part %.0f N%s\n",
                static_cast<unsigned long long>(seed), air ? "air" : "cut",
                1e-6 * of.cut.simulation.obstacle->stiffness_N_per_m,
                1e3 * m.cut.feed_per_tooth_m * m.tool.teeth / of.cut.turn_s(), of.taught_N,
                line.c_str());
  }
  for (const int air : {1, 0})
    for (const Rule rule : kContactRules) {
      const ContactSum& s = sums[air][static_cast<int>(rule)];
      std::printf(
          "    in the %s, %-18s held %2d of %2d, %d before the touch; %5.1f ms after it in the "
          "median; way %4.0f um, 95 %% %4.0f, %4.0f and %4.0f beyond the best; force %5.0f N, 95 "
          "%% %5.0f, "
          "most %5.0f\n",
          air ? "air" : "cut", kRuleNames[static_cast<int>(rule)], s.held, s.cuts, s.early,
          1e3 * quantile(s.after_s, 0.5), 1e6 * quantile(s.way_m, 0.5),
          1e6 * quantile(s.way_m, 0.95), 1e6 * quantile(s.beyond_m, 0.5),
          1e6 * quantile(s.beyond_m, 0.95), quantile(s.force_N, 0.5), quantile(s.force_N, 0.95),
          quantile(s.force_N, 1));
    }
}

// Monitors, block, link, LinuxCNC and back to the cut.
int through_linuxcnc(const char* url) {
  constexpr std::uint64_t kSeed = 742000;  // a step that less feed can end, a contact in the cut
  {
    const Overload o(kSeed);
    ThroughLinuxCnc cnc(url);
    Loading load(o.of.cut, o.limit_Nm);
    double feed = 0;
    const LoopOutcome out =
        o.of.run({.rule = Rule::loop,
                  .torque_limit_Nm = o.limit_Nm,
                  .through = std::ref(cnc),
                  .watch = [&](const MachineSample& s, const HostStack&, const MachineOverride&) {
                    load.add(s.t_s, s.cut.torque_Nm);
                    if (s.cut.torque_Nm > 0) feed = cnc.health().feed;
                  }});
    cnc.end();
    std::printf(
        "  through LinuxCNC, overload of %.2f times the limit: passed %d times, %.2f s above it, "
        "from 1 s after on at %.2f of it; %s; feed down to %.0f %%, %.0f %% at the end, %llu "
        "commands acknowledged; the simulation was up to %.2f s behind the clock\n",
        o.over, load.passes, load.above_s, load.after, out.finished ? "finished" : "held",
        100 * cnc.least().feed, 100 * feed, static_cast<unsigned long long>(cnc.health().commands),
        cnc.late_s());
    CHECK(o.reducible && out.finished && load.after < 1.05 && feed == 1);
    CHECK(cnc.least().feed < 1 / o.over + 0.1);
  }
  Cut c = draw(kSeed, Event::collision);
  c.simulation.obstacle->strength_N = HUGE_VAL;
  const Case of(std::move(c));
  ThroughLinuxCnc cnc(url);
  Contact contact;
  const LoopOutcome out = of.run({.rule = Rule::loop,
                                  .through = std::ref(cnc),
                                  .watch = [&](const MachineSample& s, const HostStack&,
                                               const MachineOverride&) { contact.add(s); }});
  cnc.end();
  std::printf(
      "  through LinuxCNC, contact: commanded %.1f ms after it, acknowledged %.1f ms after it; way "
      "%.0f um, force %.0f N; the simulation was up to %.2f s behind the clock\n",
      1e3 * (out.hold_s - contact.touch_s), 1e3 * (cnc.hold_s() - contact.touch_s),
      1e6 * contact.way_m, contact.force_N, cnc.late_s());
  CHECK(out.held && out.hold_s > contact.touch_s && cnc.hold_s() < contact.touch_s + 0.5);
  return check::done();
}

}  // namespace

int main(int argc, char** argv) {
  if (const char* url = std::getenv("SERVOSENSE_LINUXCNC")) return through_linuxcnc(url);
  const bool nightly = check::nightly(argc, argv);
  const auto [from, cases] =
      check::seed_range(argc, argv, {.from = kFirstSeed, .cases = nightly ? 40U : 2U});
  const bool development = std::any_of(
      argv + 1, argv + argc, [](const char* a) { return std::string(a) == "--development"; });
  if (const char* use = development::use_of(development::kDetection, from, cases);
      use != nullptr && !development) {
    std::printf("  these seeds were used before (%s); --development scores them all the same\n",
                use);
    return 2;
  }
  OverloadSum overload[2][8];
  overloads(from, cases, overload);
  const SoundSum sound = sound_cuts(from, cases);
  ContactSum contact[2][8];
  contacts(from, cases, contact);
  const OverloadSum& loop = overload[1][static_cast<int>(Rule::loop)];
  const OverloadSum& half = overload[1][static_cast<int>(Rule::half_feed)];
  const OverloadSum& too_much = overload[0][static_cast<int>(Rule::loop)];
  CHECK(loop.cuts > 0 && sound.cuts > 0);
  CHECK(10 * loop.finished >= 9 * loop.cuts && 10 * loop.below >= 9 * loop.cuts);
  CHECK(10 * loop.back >= 9 * loop.steps);
  CHECK(5 * loop.passes <= half.passes);
  // A program may end before the patience does.
  if (nightly) CHECK(2 * too_much.held >= too_much.cuts);
  CHECK(20 * sound.overloaded <= sound.cuts && 20 * sound.held <= sound.cuts);
  for (const auto& place : contact) {
    const ContactSum& held = place[static_cast<int>(Rule::loop)];
    const ContactSum& rival = place[static_cast<int>(Rule::current_hold)];
    CHECK(10 * held.held >= 9 * held.cuts);
    if (held.cuts == 0) continue;
    CHECK(quantile(held.after_s, 0.5) <= quantile(rival.after_s, 0.5));
    CHECK(quantile(held.beyond_m, 0.5) <= quantile(rival.beyond_m, 0.5));
  }
  return check::done();
}
