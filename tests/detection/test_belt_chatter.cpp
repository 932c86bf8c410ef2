// Chatter on a machine that shares nothing with the one that the lines of chatter were developed
// on: the second generator (second_cuts.hpp: own integrator, own controller, Kienzle forces, uneven
// pitch, chips that remember where the tool has been) with a belt between motor and spindle, whose
// resonance lies among the frequencies of chatter. The controller listens to the motor, the encoder
// is the spindle's. A cut grows to 1.3 to 2.5 times what it bears and stays there, or to 0.7 times.
// The latter is stable only where it keeps still for good at a constant speed; elsewhere it
// vibrates by itself, too little or too late for the record to show it, and is neither. An alarm
// before the cut grows is false whatever comes after it, and what chatters is found by an alarm
// after that: also by the power's that begins while a line's stands, which the stack tells as one.
//
//   belt_chatter [--cases N] [--from SEED]    --nightly: 100
// Figures: docs/chatter-lines.md.
#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>

#include "check.hpp"
#include "detection/scores.hpp"
#include "detection/second_cuts.hpp"
#include "seed_range.hpp"

using namespace servosense;
using namespace detection;

namespace belt_chatter {

constexpr std::uint64_t kDevelopment = 880000;
constexpr double kStill = 0.2, kChatters = 0.3;  // feeds per tooth, as the study
constexpr double kKeepsStill = 0.02;             // twice what the measure is off by

second::Case draw_with_belt(std::uint64_t seed) {
  second::Case c = second::draw(seed);
  second::Draw d(seed * 0x2545f4914f6cdd1dU + 5);
  second::Drive& spindle = c.machine.drive[0];
  spindle.belt_rad_s = kTwoPi * d.scale(150, 600);
  spindle.belt_damping = d.between(0.02, 0.08);
  spindle.load_share = d.between(0.3, 0.7);
  return c;
}

// When the chatter monitor raises an alarm [samples]: the first, and the first of line or power
// from the sample `from` on; the end where it does not.
struct Alarms {
  std::size_t first = 0, later = 0;
};
Alarms alarms(const second::Trace& t, const HostStackConfig& config, std::size_t from) {
  static auto stack = std::make_unique<HostStack>();
  stack->configure(config);
  const std::size_t end = t.samples.size();
  Alarms a{end, end};
  bool by_power = false;
  for (std::size_t i = 0; i < end; ++i) {
    bool raised = false;
    for (const auto& change : stack->process(t.samples[i]))
      if (change.state == MonitorState::alarm && change.monitor == MonitorId::chatter)
        raised = true, a.first = std::min(a.first, i);
    const bool was_by_power = by_power;
    by_power = stack->chatter().alarm(ChatterSign::power).state().state == MonitorState::alarm;
    if (i >= from && (raised || (by_power && !was_by_power))) a.later = std::min(a.later, i);
  }
  return a;
}

struct Count {
  // Of stable cuts those with an alarm; of all cuts those with one before they grow.
  std::size_t all = 0, in_time = 0, false_alarms = 0, early = 0;
  void print(const char* name, std::size_t of, std::size_t stable) const {
    const Interval i = wilson(static_cast<double>(all), static_cast<double>(of));
    std::printf(
        "  %-28s %zu of %zu (%.1f..%.1f %%), %zu before one feed per tooth; false %zu of "
        "%zu stable, before growth %zu of %zu\n",
        name, all, of, 100 * i.low, 100 * i.high, in_time, false_alarms, stable, early,
        of + stable);
  }
};

}  // namespace belt_chatter

int main(int argc, char** argv) {
  using namespace belt_chatter;
  const auto [first_seed, cases] =
      check::seed_range(argc, argv, {kDevelopment, check::nightly(argc, argv) ? 100U : 2U});
  Count power, lines;
  std::size_t chattering = 0, stable = 0;
  for (std::size_t n = 0; n < cases; ++n) {
    const second::Case c = draw_with_belt(first_seed + n);
    const MachineFile machine =
        second::learned(c.machine, second::idle_run(c), static_cast<unsigned>(c.teeth()));
    const HostStackConfig config = second::plan_for(machine).config;
    HostStackConfig without = config;
    without.spindle.chatter.lines.threshold = 0;
    second::Draw d(first_seed + n + 17);
    for (const bool grows : {false, true}) {
      second::Course course;
      course.cut_s = 1.5;
      course.grows_from_s = 0.3;
      course.grows_until_s = d.between(0.4, 1);
      course.grown = grows ? d.between(1.3, 2.5) : 0.7;
      const second::Trace t = second::simulate(c, course);
      const auto in = static_cast<std::size_t>((t.in_s + 0.1) / second::kPeriod_s);
      float most = 0;
      std::size_t feed = t.vibration_m.size();
      for (std::size_t i = in; i < t.vibration_m.size(); ++i) {
        most = std::max(most, t.vibration_m[i]);
        if (feed == t.vibration_m.size() && static_cast<double>(t.vibration_m[i]) >= c.feed_m)
          feed = i;
      }
      const double feeds = static_cast<double>(most) / c.feed_m;
      if (grows ? feeds < kChatters : feeds > kStill) continue;
      if (!grows && second::keeps_vibrating(c, course.grown * c.limit_m) > kKeepsStill) continue;
      const auto from =
          static_cast<std::size_t>((t.in_s + course.grows_from_s) / second::kPeriod_s);
      const Alarms with = alarms(t, config, from), alone = alarms(t, without, from);
      const std::size_t end = t.samples.size();
      CHECK(with.first <= alone.first);  // nothing is lost
      ++(grows ? chattering : stable);
      const auto count = [&](Count& to, const Alarms& at) {
        to.early += at.first < from ? 1 : 0;
        if (!grows) to.false_alarms += at.first < end ? 1 : 0;
        if (grows && at.later < end) ++to.all, to.in_time += at.later <= feed ? 1 : 0;
      };
      count(power, alone);
      count(lines, with);
    }
  }
  std::printf("  seeds %llu to %llu\n", static_cast<unsigned long long>(first_seed),
              static_cast<unsigned long long>(first_seed + cases - 1));
  power.print("power beyond the revolution", chattering, stable);
  lines.print("with lines", chattering, stable);
  CHECK(lines.all >= power.all);
  CHECK(lines.false_alarms <= power.false_alarms + 1 + stable / 100);
  CHECK(lines.early <= power.early + 1 + (chattering + stable) / 100);
  CHECK(20 * power.early <= chattering + stable + 20);  // one in twenty, and one
  return check::done();
}
