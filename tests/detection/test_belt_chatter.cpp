// Chatter on a machine that shares nothing with the one that the lines of chatter were developed
// on: the second generator (second_cuts.hpp: own integrator, own controller, Kienzle forces, uneven
// pitch, chips that remember where the tool has been) with a belt between motor and spindle, whose
// resonance lies among the frequencies of chatter. The controller listens to the motor, the encoder
// is the spindle's. A cut grows to 1.3 to 2.5 times what it bears and stays there, or to 0.7 times.
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

second::Case draw_with_belt(std::uint64_t seed) {
  second::Case c = second::draw(seed);
  second::Draw d(seed * 0x2545f4914f6cdd1dU + 5);
  second::Drive& spindle = c.machine.drive[0];
  spindle.belt_rad_s = kTwoPi * d.scale(150, 600);
  spindle.belt_damping = d.between(0.02, 0.08);
  spindle.load_share = d.between(0.3, 0.7);
  return c;
}

// When the chatter monitor alarms [samples]; the end where it does not.
std::size_t alarm(const second::Trace& t, const HostStackConfig& config) {
  static auto stack = std::make_unique<HostStack>();
  stack->configure(config);
  for (std::size_t i = 0; i < t.samples.size(); ++i)
    for (const auto& change : stack->process(t.samples[i]))
      if (change.state == MonitorState::alarm && change.monitor == MonitorId::chatter) return i;
  return t.samples.size();
}

struct Count {
  std::size_t all = 0, in_time = 0, false_alarms = 0;
  void print(const char* name, std::size_t of, std::size_t stable) const {
    const Interval i = wilson(static_cast<double>(all), static_cast<double>(of));
    std::printf(
        "  %-28s %zu of %zu (%.1f..%.1f %%), %zu before one feed per tooth; false %zu of "
        "%zu\n",
        name, all, of, 100 * i.low, 100 * i.high, in_time, false_alarms, stable);
  }
};

}  // namespace belt_chatter

int main(int argc, char** argv) {
  using namespace belt_chatter;
  const auto [from, cases] =
      check::seed_range(argc, argv, {kDevelopment, check::nightly(argc, argv) ? 100U : 2U});
  Count power, lines;
  std::size_t chattering = 0, stable = 0;
  for (std::size_t n = 0; n < cases; ++n) {
    const second::Case c = draw_with_belt(from + n);
    const MachineFile machine =
        second::learned(c.machine, second::idle_run(c), static_cast<unsigned>(c.teeth()));
    const HostStackConfig config = second::plan_for(machine).config;
    HostStackConfig without = config;
    without.spindle.chatter.lines.threshold = 0;
    second::Draw d(from + n + 17);
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
      const std::size_t with = alarm(t, config), alone = alarm(t, without);
      const std::size_t end = t.samples.size();
      CHECK(with <= alone);  // nothing is lost
      ++(grows ? chattering : stable);
      const auto count = [&](Count& to, std::size_t at) {
        if (at == end) return;
        if (!grows) ++to.false_alarms;
        if (grows) ++to.all, to.in_time += at <= feed ? 1 : 0;
      };
      count(power, alone);
      count(lines, with);
    }
  }
  std::printf("  seeds %llu to %llu\n", static_cast<unsigned long long>(from),
              static_cast<unsigned long long>(from + cases - 1));
  power.print("power beyond the revolution", chattering, stable);
  lines.print("with lines", chattering, stable);
  CHECK(lines.all >= power.all);
  CHECK(lines.false_alarms <= power.false_alarms + 1 + stable / 100);
  return check::done();
}
