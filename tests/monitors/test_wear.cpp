// Wear monitor: holes against the force put in, the source's rules (Koike 2016, section 4.3) one by
// one, faults, evidence; misses and false alarms on random tools beside a fixed limit. Signals are
// drilled and tapped by a small machine of its own: trapezoidal feeds, friction that warms up,
// screw ripple, inertia error, both observer filters.
// --nightly: more tools.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/monitors/event_text.hpp"
#include "servosense/monitors/monitor_stack.hpp"
#include "servosense/monitors/wear.hpp"
#include "servosense/sim/gaussian_noise.hpp"

namespace {

using namespace servosense;
using Monitor = WearMonitor<double>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// ---- the machine that makes the signals --------------------------------------------------------

struct Tool {
  bool tap = false;
  double speed_rad_s = rad_s_from_rpm(9000);
  double feed_m_s = m_s_from_mm_min(1800);
  double depth_m = 0.02;
  double entry_m = 1.8e-3;  ///< over which force rises: the point of a 6 mm drill
  double through_m = 0;     ///< thickness of the plate; 0 = blind
  double thrust_N = 400;    ///< in the full cut
  double torque_Nm = 0.8;
  double chips = 0.05;  ///< fluctuation of both, part of them
};

/// What the observers get wrong in the air: what has changed since the identification.
struct Errors {
  double offset_N = 0, coulomb_N = 0, viscous_N = 0;  ///< the last at rapid
  double spindle_Nm = 0;
  double ripple_N = 0;       ///< once a turn of the screw, 16 mm
  double mass_kg = 0;        ///< of 380
  double inertia_kg_m2 = 0;  ///< of 0.0048
};

class Machine {
 public:
  static constexpr double kRapid = 50.0 / 60;
  /// Axis force, feed increment (drilling goes to -z), torque, angle increment.
  using Sink = std::function<void(double, double, double, double)>;

  double period_s;
  Errors cold, warm;       ///< from one to the other...
  double warming_s = 300;  ///< ...with this time constant
  double noise_N = 10, noise_Nm = 0.02;
  double clearance_m = 3e-3;
  double time_s = 0;
  // Of the last hole, from what was put in: the plateau without friction and noise.
  double plateau_N = 0, plateau_Nm = 0;

  Machine(std::uint64_t seed, double period, Sink sink)
      : period_s(period), noise_(seed), sink_(std::move(sink)) {
    const double gT = 500 * period_s;
    pole_ = gT / (1 + gT);
  }

  /// Spindle on, down, drill, up, aside. `pecks`: with full retraction between them.
  void hole(const Tool& tool, int pecks = 1) {
    tool_ = tool;
    deepest_ = 0;
    sum_N_ = sum_Nm_ = count_ = 0;
    spin(tool.speed_rad_s);
    for (int peck = 1; peck <= pecks; ++peck) {
      const double to = tool.depth_m * peck / pecks;
      const double from = peck == 1 ? -clearance_m : deepest_ - 0.5e-3;
      move_to(from, kRapid);
      move_to(to, tool.feed_m_s);
      if (tool.tap) {
        spin(0);
        spin(-tool.speed_rad_s);
        move_to(-clearance_m, tool.feed_m_s);
        spin(0);
      }
      move_to(-clearance_m, kRapid);
    }
    move_to(-0.05, kRapid);
    wait(0.3);
    plateau_N = count_ > 0 ? sum_N_ / count_ : 0;
    plateau_Nm = count_ > 0 ? sum_Nm_ / count_ : 0;
  }
  void wait(double seconds) {
    for (double until = time_s + seconds; time_s < until;) step(0);
  }
  /// Nothing runs; friction cools or warms meanwhile.
  void pause(double seconds) { time_s += seconds; }
  /// Strokes in the air at rapid, spindle on: what a warm-up program does.
  void move_to(double depth, double feed) {
    const double acceleration = 10;
    while (std::abs(depth - depth_) > 1e-9) {
      const double left = depth - depth_;
      const double stop = std::sqrt(2 * acceleration * std::abs(left));
      double v = std::copysign(std::min(feed, stop), left);
      if (feed < 0.2) v = std::copysign(feed, left);  // short of what matters
      v = std::clamp(v, v_ - acceleration * period_s, v_ + acceleration * period_s);
      if (std::abs(v) * period_s >= std::abs(left)) v = left / period_s;
      step(v);
    }
    step(0);
  }
  void spin(double speed) {
    const double ramp = 3000 * period_s;  // rad/s2
    while (std::abs(speed - w_) > 1e-9) {
      w_to_ = std::clamp(speed, w_ - ramp, w_ + ramp);
      step(0);
    }
  }

 private:
  void step(double v) {
    const double a = (v - v_) / period_s, alpha = (w_to_ - w_) / period_s;
    v_ = v;
    w_ = w_to_;
    depth_ += v_ * period_s;
    const double part = 1 - std::exp(-time_s / warming_s);
    auto now = [&](double Errors::*e) { return cold.*e + (warm.*e - cold.*e) * part; };
    const double sign = v_ > 0 ? 1 : v_ < 0 ? -1 : 0;
    // Along the feed; the sink gets it along +z, which is up.
    double force = now(&Errors::offset_N) + sign * now(&Errors::coulomb_N) +
                   now(&Errors::viscous_N) * v_ / kRapid + now(&Errors::mass_kg) * a +
                   sign * now(&Errors::ripple_N) * std::sin(kTwoPi * depth_ / 0.016);
    double torque = (w_ > 0   ? 1
                     : w_ < 0 ? -1
                              : 0) *
                        now(&Errors::spindle_Nm) +
                    now(&Errors::inertia_kg_m2) * alpha;
    const bool in_work = depth_ > deepest_ && v_ > 0;
    deepest_ = std::max(deepest_, depth_);
    double full = std::clamp(depth_ / tool_.entry_m, 0.0, 1.0);
    if (tool_.through_m > 0)
      full = std::min(full, std::clamp(1 - (depth_ - tool_.through_m) / tool_.entry_m, 0.0, 1.0));
    if (in_work) {
      const double chips = 1 + tool_.chips * noise_.next();
      force += full * tool_.thrust_N * chips;
      torque += full * tool_.torque_Nm * (1 + tool_.chips * noise_.next());
      if (full >= 1) {
        sum_N_ += tool_.thrust_N;
        sum_Nm_ += tool_.torque_Nm;
        ++count_;
      }
    } else if (tool_.tap && depth_ > 0) {
      torque += (w_ < 0 ? -0.3 : 0.0) * tool_.torque_Nm;  // turning out of the thread
    }
    force += noise_N * noise_.next();
    torque += noise_Nm * noise_.next();
    for (double* y : {&force1_, &force2_}) force = *y += pole_ * (force - *y);
    for (double* y : {&torque1_, &torque2_}) torque = *y += pole_ * (torque - *y);
    time_s += period_s;
    sink_(-force, -v_ * period_s, torque, w_ * period_s);
  }

  GaussianNoise noise_;
  Sink sink_;
  Tool tool_;
  double pole_ = 0;
  double depth_ = -0.05, v_ = 0, w_ = 0, w_to_ = 0, deepest_ = 0;
  double force1_ = 0, force2_ = 0, torque1_ = 0, torque2_ = 0;
  double sum_N_ = 0, sum_Nm_ = 0, count_ = 0;
};

template <typename Real, std::size_t Kept = 128>
struct Run {
  std::unique_ptr<WearMonitor<Real, Kept>> monitor = std::make_unique<WearMonitor<Real, Kept>>();
  Machine machine;
  Quality quality = Quality::good;  ///< of the next samples
  MonitorState before = MonitorState::idle;
  int alarms = 0;
  bool warned = false;

  Run(const WearConfig& c, std::uint64_t seed)
      : machine(seed, c.sample_period_s,
                [this](double f, double x, double t, double a) { feed(f, x, t, a); }) {
    CHECK((WearMonitor<Real, Kept>::validate(c).ok()));
    monitor->configure(c);
  }
  Run(const Run&) = delete;
  Run& operator=(const Run&) = delete;
  /// Switched off for a while.
  void pause(double seconds) {
    machine.pause(seconds);
    restart();
  }
  void restart() {
    quality = Quality::restarted;
    feed(0, 0, 0, 0);
    quality = Quality::good;
  }
  void feed(double force, double feed_m, double torque, double angle) {
    const MonitorState now =
        monitor->process(static_cast<Real>(force), static_cast<Real>(feed_m),
                         static_cast<Real>(torque), static_cast<Real>(angle), quality);
    alarms += now == MonitorState::alarm && before != MonitorState::alarm;
    warned = warned || now == MonitorState::warning;
    before = now;
  }
};

WearConfig slow(WearConfig c) {  // 2 kHz: the parts are the same, the tests four times shorter
  c.sample_period_s = 500e-6;
  c.equivalent_mass_kg = 380;  // as the stack sets them
  c.inertia_kg_m2 = 0.0048;
  return c;
}

// ---- holes -------------------------------------------------------------------------------------

// Mean, peak and count of a hole against what was put in: friction far off, entry and exit there.
template <typename Real>
void holes_as_put_in() {
  struct Case {
    const char* name;
    WearConfig config;
    Tool tool;
    int pecks;
  };
  std::vector<Case> cases;
  cases.push_back({"6 mm drill", WearConfig::drill_6mm(), {}, 1});
  Tool three;
  three.feed_m_s = m_s_from_mm_min(1350);
  three.depth_m = 0.015;
  three.entry_m = 0.9e-3;
  three.thrust_N = 180;
  three.torque_Nm = 0.1;
  cases.push_back({"3 mm drill", WearConfig::drill_3mm(), three, 1});
  Tool tap;
  tap.tap = true;
  tap.speed_rad_s = rad_s_from_rpm(2120);
  tap.feed_m_s = m_s_from_mm_min(2120);
  tap.depth_m = 0.012;
  tap.entry_m = 2e-3;
  tap.thrust_N = 20;
  tap.torque_Nm = 0.8;
  cases.push_back({"M6 tap", WearConfig::tap_m6(), tap, 1});
  Tool through;
  through.through_m = 0.015;
  cases.push_back({"through hole", WearConfig::drill_6mm(), through, 1});
  WearConfig deep = WearConfig::drill_6mm();
  deep.peck_window_s = 1;
  Tool long_hole;
  long_hole.depth_m = 0.045;
  cases.push_back({"three pecks", deep, long_hole, 3});

  for (const Case& k : cases) {
    Run<Real> run(k.config, 11);
    run.machine.cold = run.machine.warm = {40, 60, 100, 0.05, 6, 8, 1e-4};
    const int holes = 6;
    double worst_N = 0, worst_Nm = 0;
    for (int n = 0; n < holes; ++n) {
      run.machine.hole(k.tool, k.pecks);
      if (k.config.peck_window_s > 0) run.machine.wait(1.2);
      const auto& hole = run.monitor->hole();
      CHECK(run.monitor->tool().holes == static_cast<unsigned>(n + 1));
      worst_N =
          std::max(worst_N, std::abs(static_cast<double>(hole.thrust_N) - run.machine.plateau_N));
      worst_Nm = std::max(worst_Nm,
                          std::abs(static_cast<double>(hole.torque_Nm) - run.machine.plateau_Nm));
      CHECK(hole.thrust_peak_N > hole.thrust_N && hole.torque_peak_Nm > hole.torque_Nm);
      CHECK(static_cast<double>(hole.travel_m) <= k.tool.depth_m);
      CHECK(static_cast<double>(hole.travel_m) >= k.config.shortest_m);
    }
    CHECK(run.monitor->core().short_cuts == 0);
    check::figure(std::string("hole: thrust off by, at most, ") + k.name, worst_N, "N");
    check::figure(std::string("hole: torque off by, at most, ") + k.name, worst_Nm, "Nm");
    // Screw ripple of 6 N over a stretch that is no whole number of turns, learned and in the hole;
    // friction was 100 N off. Torque: 5 % chips and noise of 0.02 Nm, averaged.
    CHECK(worst_N < 15);
    CHECK(worst_Nm < 0.02);
  }
}

// Air, rapids, strokes too short, spindle at rest, the wrong way: no hole.
void what_is_no_hole() {
  WearConfig c = slow(WearConfig::drill_6mm());
  Run<double> run(c, 12);
  run.machine.cold = run.machine.warm = {0, 100, 150, 0, 0, 20, 0};  // 250 N at rapid
  Tool air;
  air.thrust_N = air.torque_Nm = 0;
  for (int n = 0; n < 5; ++n) run.machine.hole(air);
  CHECK(run.monitor->tool().holes == 0 && run.monitor->core().short_cuts == 0);
  Tool shallow;
  shallow.depth_m = 0.005;
  for (int n = 0; n < 3; ++n) run.machine.hole(shallow);
  CHECK(run.monitor->tool().holes == 0 && run.monitor->core().short_cuts == 3);
  Tool standing;
  standing.speed_rad_s = 0;
  run.machine.hole(standing);
  CHECK(run.monitor->tool().holes == 0);
  // Upwards drilling needs the other direction.
  WearConfig up = c;
  up.feed_direction = 1;
  Run<double> other(up, 13);
  other.machine.hole({});
  CHECK(other.monitor->tool().holes == 0);
}

// Passes to and fro, feed_direction 0.
void passes() {
  WearConfig c = slow(WearConfig::drill_6mm());
  c.feed_direction = 0;
  Monitor monitor;
  CHECK(Monitor::validate(c).ok());
  monitor.configure(c);
  GaussianNoise random(14);
  const double feed = 0.02;
  for (int pass = 0; pass < 6; ++pass) {
    const double sign = pass % 2 == 0 ? 1 : -1;
    for (int n = 0; n < 6000; ++n) {
      const double t = n * c.sample_period_s;
      const double cut =
          std::clamp((t - 0.5) / 0.05, 0.0, 1.0) * std::clamp((2.5 - t) / 0.05, 0.0, 1.0);
      monitor.process(sign * (25 + 300 * cut) + 10 * random.next(), sign * feed * c.sample_period_s,
                      1 * cut, 0.1, Quality::good);
    }
    CHECK(monitor.tool().holes == static_cast<unsigned>(pass + 1));
    CHECK_NEAR(monitor.hole().thrust_N, 300.0, 6.0);
    CHECK_NEAR(monitor.hole().torque_Nm, 1.0, 1e-9);
  }
}

// ---- rules -------------------------------------------------------------------------------------

struct Verdict {
  int alarms = 0;
  unsigned hole = 0;  ///< that raised the alarm
  WearRule rule = WearRule::none;
  bool warned = false;
  MonitorState last = MonitorState::idle;
};

// Holes with the given thrust and torque, one after the other.
Verdict drill(const WearConfig& c, Tool tool, const std::vector<double>& level, bool of_torque,
              std::uint64_t seed, const Errors& cold = {}, const Errors& warm = {}) {
  Run<double> run(slow(c), seed);
  run.machine.cold = cold;
  run.machine.warm = warm;
  for (const double x : level) {
    (of_torque ? tool.torque_Nm : tool.thrust_N) = x;
    run.machine.hole(tool);
  }
  const auto& t = run.monitor->tool();
  CHECK(t.holes == level.size());
  return {run.alarms, t.alarm_hole, t.rule, run.warned, run.monitor->state().state};
}

// The first hole at which the mean of the last ones reaches the limit: by hand.
unsigned expected_hole(const std::vector<double>& level, double limit, std::size_t average) {
  for (std::size_t n = 1; n < level.size(); ++n) {
    const std::size_t from = n >= average ? n - average + 1 : 0;
    double sum = 0;
    for (std::size_t k = from; k <= n; ++k) sum += level[k];
    if (sum / static_cast<double>(n - from + 1) >= limit) return static_cast<unsigned>(n + 1);
  }
  return 0;
}

Tool drill_of(double diameter_mm) {
  Tool t;
  if (diameter_mm < 4) {
    t.feed_m_s = m_s_from_mm_min(1350);
    t.depth_m = 0.015;
    t.entry_m = 0.9e-3;
    t.torque_Nm = 0.1;
  }
  return t;
}
Tool tap_of(double size_mm) {
  Tool t;
  t.tap = true;
  t.speed_rad_s = rad_s_from_rpm(size_mm > 4 ? 2120 : 4300);
  t.feed_m_s = m_s_from_mm_min(size_mm > 4 ? 2120 : 2150);
  t.depth_m = size_mm > 4 ? 0.012 : 0.006;
  t.entry_m = 1e-3;
  t.thrust_N = 20;
  return t;
}
std::vector<double> ramp(double from, double to, int holes) {
  std::vector<double> level;
  for (int n = 0; n < holes; ++n) level.push_back(from + (to - from) * n / (holes - 1));
  return level;
}
std::vector<double> stepped(double before, double after, int at, int holes) {
  std::vector<double> level(static_cast<std::size_t>(at), before);
  level.resize(static_cast<std::size_t>(holes), after);
  return level;
}

void rules_of_the_source() {
  struct Case {
    const char* name;
    WearConfig config;
    Tool tool;
    double from, to, limit;
    bool torque;
    WearRule rule;
  };
  const Case ramps[] = {
      {"6 mm drill, 800 N", WearConfig::drill_6mm(), drill_of(6), 500, 900, 800, false,
       WearRule::thrust_limit},
      {"3 mm drill, 330 N", WearConfig::drill_3mm(), drill_of(3), 180, 380, 330, false,
       WearRule::thrust_limit},
      {"M6 tap, 2.5 Nm", WearConfig::tap_m6(), tap_of(6), 1.2, 2.9, 2.5, true,
       WearRule::torque_limit},
  };
  for (const Case& k : ramps) {
    for (const unsigned average : {10U, 3U}) {  // the source's, and the default
      WearConfig c = k.config;
      c.average_holes = average;
      const std::vector<double> level = ramp(k.from, k.to, 60);
      const Verdict v = drill(c, k.tool, level, k.torque, 21);
      check::that(v.alarms == 1 && v.rule == k.rule && v.warned, k.name, __FILE__, __LINE__);
      // What friction and noise leave of a level moves the crossing by a hole or two.
      check::near(v.hole, expected_hole(level, k.limit, average), 2, k.name, __FILE__, __LINE__);
      check::that(v.last == MonitorState::alarm, k.name, __FILE__, __LINE__);
    }
  }
  for (const auto& [size, config] :
       {std::pair{6.0, WearConfig::tap_m6()}, std::pair{3.0, WearConfig::tap_m3()}}) {
    const double initial = size > 4 ? 0.7 : 0.2;
    std::vector<double> level(10, initial);
    for (const double x : ramp(initial, 3.4 * initial, 50)) level.push_back(x);
    const Verdict v = drill(config, tap_of(size), level, true, 22);
    CHECK(v.alarms == 1 && v.rule == WearRule::torque_ratio);
    CHECK_NEAR(v.hole, expected_hole(level, 3 * initial, 3), 2);
  }
  // Chipping: a step of the limit itself and more; the verdict comes with the second hole.
  for (const double size : {6.0, 3.0}) {
    const WearConfig c = size > 4 ? WearConfig::drill_6mm() : WearConfig::drill_3mm();
    const double base = size > 4 ? 450 : 200;
    for (const double share : {1.05, 1.5, 2.0}) {
      for (const std::uint64_t seed : {23U, 24U, 25U}) {
        const double step = share * c.thrust_step_N;
        const Verdict v = drill(c, drill_of(size), stepped(base, base + step, 15, 20), false, seed);
        CHECK(v.alarms == 1 && v.rule == WearRule::thrust_rise && v.hole == 17);
        const Verdict down =
            drill(c, drill_of(size), stepped(base, base - step, 15, 20), false, seed);
        CHECK(down.alarms == 1 && down.rule == WearRule::thrust_drop && down.hole == 17);
      }
    }
    // One odd hole is no step, nor is a step of a little more than half the limit.
    std::vector<double> odd(20, base);
    odd[15] += 1.5 * c.thrust_step_N;
    CHECK(drill(c, drill_of(size), odd, false, 26).alarms == 0);
    CHECK(drill(c, drill_of(size), stepped(base, base + 0.55 * c.thrust_step_N, 15, 30), false, 27)
              .alarms == 0);
  }
}

// The tool is worn, whatever comes after: a fractured tap whose torque falls.
void a_drop_clears_nothing() {
  std::vector<double> level = ramp(1.2, 2.9, 40);
  for (int n = 0; n < 30; ++n) level.push_back(1.5);
  const Verdict v = drill(WearConfig::tap_m6(), tap_of(6), level, true, 31);
  CHECK(v.alarms == 1 && v.rule == WearRule::torque_limit && v.last == MonitorState::alarm);
}

// Friction that warms up by 55 N: no alarm, no warning, whichever way and wherever it goes, also
// close below the limit and over a pause. A step of 100 N in the middle of it does.
void warming_up() {
  struct Case {
    const char* name;
    Errors warm;
    double pause_s;
  };
  const Case cases[] = {
      {"Coulomb friction up", {0, 55, 0, 0.05, 0, 0, 0}, 0},
      {"Coulomb friction down", {0, -55, 0, -0.05, 0, 0, 0}, 0},
      {"viscous friction at rapid", {0, 0, -55, 0, 0, 0, 0}, 0},
      {"offset", {55, 0, 0, 0, 0, 0, 0}, 0},
      {"a pause between two holes", {0, 55, 0, 0.05, 0, 0, 0}, 1e6},
  };
  double worst = 0;
  for (const Case& k : cases) {
    for (const double size : {6.0, 3.0}) {
      const WearConfig c = slow(size > 4 ? WearConfig::drill_6mm() : WearConfig::drill_3mm());
      Tool tool = drill_of(size);
      tool.thrust_N = c.thrust_limit_N - 25;  // less than the drift below it
      WearConfig quiet = c;
      quiet.warning_fraction = 1;
      Run<double> run(quiet, 41);
      run.machine.warm = k.warm;
      run.machine.warming_s = 60;
      for (int n = 0; n < 80; ++n) {
        if (n == 20 && k.pause_s > 0) run.pause(k.pause_s);
        run.machine.hole(tool);
        worst = std::max(worst, std::abs(run.monitor->hole().thrust_N - tool.thrust_N));
      }
      check::that(run.alarms == 0 && !run.warned && run.monitor->tool().holes == 80, k.name,
                  __FILE__, __LINE__);
      if (size < 4) continue;
      // The same with a tool that chips.
      Run<double> chips(quiet, 42);
      chips.machine.warm = k.warm;
      chips.machine.warming_s = 60;
      for (int n = 0; n < 30; ++n) {
        if (n == 20 && k.pause_s > 0) chips.pause(k.pause_s);
        tool.thrust_N = n < 25 ? 450 : 550;
        chips.machine.hole(tool);
      }
      check::that(chips.alarms == 1 && chips.monitor->tool().rule == WearRule::thrust_rise &&
                      chips.monitor->tool().alarm_hole == 27,
                  k.name, __FILE__, __LINE__);
    }
  }
  check::figure("drift of 55 N: a hole is off by, at most", worst, "N");
  CHECK(worst < 25);
}

// ---- tools -------------------------------------------------------------------------------------

void tools_in_turn() {
  const WearConfig c = slow(WearConfig::drill_6mm());
  Run<double> run(c, 51);
  Tool first = drill_of(6), second = drill_of(6);
  first.thrust_N = 400;
  second.thrust_N = 570;  // another one, 170 N apart
  for (int n = 0; n < 12; ++n) run.machine.hole(first);
  CHECK(run.monitor->state().state == MonitorState::armed);
  const Monitor::Tool magazine = run.monitor->tool();
  CHECK(magazine.holes == 12 && magazine.taught == 10);
  CHECK_NEAR(magazine.thrust.taught, 400.0, 10.0);
  run.monitor->new_tool();
  for (int n = 0; n < 12; ++n) {
    run.machine.hole(second);
    CHECK(run.monitor->state().state == (n < 9 ? MonitorState::learning : MonitorState::armed));
  }
  CHECK_NEAR(run.monitor->tool().thrust.taught, 570.0, 10.0);
  run.monitor->new_tool(magazine);
  run.machine.hole(first);
  CHECK(run.alarms == 0 && run.monitor->tool().holes == 13);
  // Chipped: an alarm; in the magazine and back it still has it. A new one has not.
  first.thrust_N = 560;
  for (int n = 0; n < 2; ++n) run.machine.hole(first);
  CHECK(run.alarms == 1);
  const Monitor::Tool chipped = run.monitor->tool();
  run.monitor->new_tool();
  run.machine.hole(second);
  CHECK(run.monitor->state().state == MonitorState::learning);
  run.monitor->new_tool(chipped);
  run.machine.hole(first);
  CHECK(run.monitor->state().state == MonitorState::alarm && run.monitor->state().alarms == 1);

  // Taught elsewhere.
  WearConfig tap = slow(WearConfig::tap_m3());
  Run<double> known(tap, 52);
  known.monitor->set_taught(0, 0, 0.1, 0.005);
  Tool worn = tap_of(3);
  worn.torque_Nm = 0.33;
  known.machine.hole(worn);
  CHECK(known.alarms == 0);
  known.machine.hole(worn);
  CHECK(known.alarms == 1 && known.monitor->tool().rule == WearRule::torque_ratio);
}

// The warning of a ratio lies between 1, a sound tool, and the ratio. With a ratio near 1 a
// fraction of the ratio itself lies below 1, and every sound tool would be warned of.
void ratios_warn_above_a_sound_tool() {
  GaussianNoise noise(77);
  for (const double ratio : {1.05, 1.235, 1.5, 3.0}) {
    WearConfig c = WearConfig::drill_6mm();
    c.thrust_limit_N = c.thrust_step_N = 0;
    c.thrust_ratio = ratio;
    CHECK(Monitor::validate(c).ok());
    WearRules<double> rules;
    rules.configure(c);
    for (int tool = 0; tool < 20; ++tool) {
      WearTool<double> t;
      for (int hole = 0; hole < 40; ++hole) rules.judge(t, 500 * (1 + 0.01 * noise.next()), 1);
      CHECK(t.condition == MonitorState::armed);
    }
    // A tool that wears: by three quarters of the way a warning, at its end the alarm.
    WearTool<double> t;
    for (unsigned hole = 0; hole < c.teach_holes; ++hole) rules.judge(t, 500, 1);
    const auto worn = [&](double part) {
      for (unsigned hole = 0; hole < c.average_holes; ++hole)
        rules.judge(t, 500 * (1 + part * (ratio - 1)), 1);
      return t.condition;
    };
    CHECK(worn(0.7) == MonitorState::armed);
    CHECK(worn(0.8) == MonitorState::warning && t.rule == WearRule::thrust_ratio);
    StateChange<double> change;
    change.monitor = MonitorId::wear;
    change.state = t.condition;
    change.detail = static_cast<std::uint8_t>(t.rule);
    CHECK_TEXT(event_from(change, 0).reason,
               "thrust grows towards its ratio to that of the first holes");
    CHECK(worn(0.95) == MonitorState::warning);
    CHECK(worn(1.01) == MonitorState::alarm);
  }
}

// ---- faults ------------------------------------------------------------------------------------

// Every fault, everywhere in a hole: never an alarm, and all is well with the next hole.
template <typename Real>
void faults() {
  struct Fault {
    Quality quality;
    double value;
    int length;
    bool breaks;  ///< the hole is given up
  };
  const Fault kinds[] = {{Quality::good, kNan, 1, false},
                         {Quality::good, std::numeric_limits<double>::infinity(), 3, false},
                         {Quality::good, 1e20, 2, false},
                         {Quality::missing, 0, 3, false},
                         {Quality::jump, 5e4, 2, false},
                         {Quality::stuck, 5e4, 50, false},
                         {Quality::invalid | Quality::missing, 5e4, 150, false},
                         {Quality::gap | Quality::missing, 5e4, 40, true},
                         {Quality::restarted, 300, 1, true},
                         {Quality::settling, 3000, 60, true}};
  const WearConfig c = slow(WearConfig::drill_6mm());
  for (const Fault& fault : kinds) {
    for (int at = 0; at < 1800; at += 97) {
      Run<Real, 1> run(c, 61);
      auto& m = *run.monitor;
      m.set_taught(400, 3, Real(0.8), Real(0.01));
      const Tool tool = drill_of(6);
      for (int n = 0; n < 5; ++n) run.machine.hole(tool);
      const std::uint64_t broken = m.core().broken_cuts;
      int n = 0;
      bool flagged = true;
      std::uint64_t holes = 0;
      Machine twin(62, c.sample_period_s, [&](double f, double x, double t, double a) {
        const bool bad = n >= at && n < at + fault.length;
        ++n;
        const bool all = !is_finite(fault.value);
        const MonitorState s =
            m.process(static_cast<Real>(bad ? fault.value : f),
                      static_cast<Real>(bad && all ? fault.value : x), static_cast<Real>(t),
                      static_cast<Real>(a), bad ? fault.quality : Quality::good);
        if (bad && !has(fault.quality, Quality::restarted | Quality::settling))
          flagged = flagged && s == MonitorState::signal_fault;
        else if (bad)
          flagged = flagged && s == MonitorState::learning;
        else
          flagged = flagged && s == MonitorState::armed;
      });
      twin.hole(tool);
      holes = m.state().holes;
      CHECK(flagged);
      CHECK(holes + (m.core().broken_cuts - broken) + m.core().short_cuts >= 6);
      CHECK(fault.breaks || holes == 6);
      CHECK(m.state().alarms == 0 && m.tool().condition == MonitorState::armed);
      if (holes == 6) CHECK_NEAR(static_cast<double>(m.hole().thrust_N), 400.0, 12.0);
      twin.hole(tool);
      CHECK(m.state().holes == holes + 1);
    }
  }
  // A worn tool stays worn over a fault; while it lasts, the signal is what is wrong.
  Run<Real, 1> run(c, 63);
  Tool tool = drill_of(6);
  tool.thrust_N = 900;
  for (int n = 0; n < 3; ++n) run.machine.hole(tool);
  CHECK(run.monitor->state().state == MonitorState::alarm);
  run.quality = Quality::missing;
  run.machine.wait(0.01);
  CHECK(run.monitor->state().state == MonitorState::signal_fault);
  run.quality = Quality::good;
  run.machine.wait(0.01);
  CHECK(run.monitor->state().state == MonitorState::alarm && run.monitor->state().alarms == 1);
}

// ---- evidence ----------------------------------------------------------------------------------

template <typename Real>
void evidence() {
  const WearConfig c = WearConfig::drill_6mm();
  Run<Real> run(c, 71);
  CHECK(run.monitor->evidence().count == 0);
  Tool tool = drill_of(6);
  for (int n = 0; n < 12; ++n) run.machine.hole(tool);
  tool.thrust_N = 540;
  run.machine.hole(tool);
  run.machine.hole(tool);
  CHECK(run.monitor->state().state == MonitorState::alarm);
  const auto at_alarm = run.monitor->tool();
  for (int n = 0; n < 3; ++n) run.machine.hole(tool);
  const auto e = run.monitor->evidence();
  CHECK(e.count > 50 && e.before.tool.condition == MonitorState::armed);
  const auto core = run.monitor->replay(e);
  CHECK(core.tool.condition == MonitorState::alarm);
  CHECK(core.tool.rule == at_alarm.rule && core.tool.alarm_hole == at_alarm.alarm_hole);
  CHECK(std::memcmp(&core.tool.value, &at_alarm.value, sizeof(Real)) == 0);
  CHECK(std::memcmp(&core.tool.threshold, &at_alarm.threshold, sizeof(Real)) == 0);
  CHECK(std::memcmp(&core.tool.thrust.hole, &at_alarm.thrust.hole, sizeof at_alarm.thrust.hole) ==
        0);
  // A hole longer than what is kept: an alarm without evidence.
  Run<Real, 8> small(c, 72);
  for (int n = 0; n < 3; ++n) {
    tool.thrust_N = 900;
    small.machine.hole(tool);
  }
  CHECK(small.alarms == 1 && small.monitor->evidence().count == 0);
  static_assert(std::is_trivially_copyable_v<typename WearMonitor<Real>::Core>);
  static_assert(std::is_trivially_copyable_v<typename WearMonitor<Real>::State>);
}

void validation() {
  struct Case {
    const char* parameter;
    void (*spoil)(WearConfig&);
  };
  const Case cases[] = {
      {"sample_period_s", [](WearConfig& c) { c.sample_period_s = kNan; }},
      {"part_s", [](WearConfig& c) { c.part_s = 5e-4; }},
      {"feed_direction", [](WearConfig& c) { c.feed_direction = 2; }},
      {"cutting_thrust_N", [](WearConfig& c) { c.cutting_thrust_N = 0; }},
      {"cutting_torque_Nm", [](WearConfig& c) { c.cutting_torque_Nm = -1; }},
      {"release_fraction", [](WearConfig& c) { c.release_fraction = 1.5; }},
      {"maximum_feed_m_s", [](WearConfig& c) { c.maximum_feed_m_s = 0; }},
      {"entry_m", [](WearConfig& c) { c.entry_m = -1; }},
      {"thrust_limit_N", [](WearConfig& c) { c.thrust_limit_N = kNan; }},
      {"torque_ratio", [](WearConfig& c) { c.torque_ratio = 0.5; }},
      {"warning_fraction", [](WearConfig& c) { c.warning_fraction = 0; }},
      {"teach_holes", [](WearConfig& c) { c.teach_holes = 1; }},
      {"average_holes", [](WearConfig& c) { c.average_holes = 17; }},
      {"confirm_holes", [](WearConfig& c) { c.confirm_holes = 0; }},
      {"friction_noise_N", [](WearConfig& c) { c.friction_noise_N = 0; }},
      {"tolerated_stand_ins", [](WearConfig& c) { c.tolerated_stand_ins = 1; }},
  };
  for (const Case& k : cases) {
    WearConfig c = WearConfig::drill_6mm();
    CHECK(Monitor::validate(c).ok());
    k.spoil(c);
    const Status s = Monitor::validate(c);
    CHECK(!s.ok());
    CHECK_TEXT(s.parameter(), k.parameter);
  }
  for (const WearConfig& c : {WearConfig::drill_3mm(), WearConfig::tap_m6(), WearConfig::tap_m3()})
    CHECK(Monitor::validate(c).ok());
  // Without a rule it idles.
  WearConfig off = slow(WearConfig::drill_6mm());
  off.thrust_limit_N = off.thrust_step_N = 0;
  Run<double> run(off, 81);
  run.machine.hole(drill_of(6));
  CHECK(run.monitor->state().state == MonitorState::idle && run.monitor->tool().holes == 1);
}

// ---- misses and false alarms -------------------------------------------------------------------

// Random drills on random machines. Every tool is drilled once sound, once to its limit, once with
// an edge that chips. Beside it what a fixed limit does: the same 800 or 330 N on the raw thrust,
// averaged over 0.1 s; and a step rule on the raw mean of the stroke.
struct Score {
  int sound = 0, worn = 0, chipped = 0;  ///< right answers
};
struct Tally {
  Score monitor, fixed_limit;
  double square_N2 = 0;  ///< errors of the holes' means, summed
  int holes = 0;
};

class Naive {
 public:
  Naive(double limit, double step) : limit_(limit), step_(step) {}
  bool alarm = false;

  void add(double force, double feed_m, double period_s) {
    // A stroke at feed, downwards; rapids are known from the program.
    const bool stroke = -feed_m / period_s > 1e-3 && -feed_m / period_s < 0.1;
    if (!stroke) {
      if (count_ * period_s > 0.2) end();
      count_ = sum_ = mean_ = 0;
      return;
    }
    sum_ += -force;
    ++count_;
    mean_ += period_s / 0.1 * (-force - mean_);
    alarm = alarm || mean_ > limit_;
  }

 private:
  void end() {
    const double hole = sum_ / count_;
    alarm = alarm || (last_ > 0 && std::abs(hole - last_) > step_);
    last_ = hole;
  }
  double limit_, step_;
  double sum_ = 0, count_ = 0, mean_ = 0, last_ = 0;
};

enum class Fate { sound, worn, chipped };

void one_tool(std::uint64_t seed, Fate fate, Tally& tally) {
  GaussianNoise random(seed * 7919 + 17);
  auto between = [&](double a, double b) { return a + (b - a) * random.uniform(); };
  const bool large = random.uniform() < 0.5;
  WearConfig c = slow(large ? WearConfig::drill_6mm() : WearConfig::drill_3mm());
  c.warning_fraction = 1;
  Tool tool = drill_of(large ? 6 : 3);
  tool.feed_m_s *= between(0.5, 1.3);
  tool.depth_m *= between(0.8, 1.5);
  tool.chips = between(0.03, 0.15);
  const double fresh = c.thrust_limit_N * between(0.5, 0.65);
  const double scatter = fresh * between(0.003, 0.015);  // hole to hole
  Run<double, 1> run(c, seed);
  Naive naive(c.thrust_limit_N, c.thrust_step_N);
  Machine machine(seed, c.sample_period_s, [&](double f, double x, double t, double a) {
    run.feed(f, x, t, a);
    naive.add(f, x, c.sample_period_s);
  });
  // Friction off by up to 55 N for each cause when warm, by half of that at the start.
  auto off = [&](double most) {
    return Errors{between(-most, most) * 0.3,
                  between(-most, most),
                  between(-most, most),
                  between(-0.05, 0.05),
                  0,
                  0,
                  0};
  };
  machine.cold = off(27);
  machine.warm = off(55);
  machine.cold.ripple_N = machine.warm.ripple_N = between(0, 6);
  machine.cold.mass_kg = machine.warm.mass_kg = between(-12, 12);
  machine.warming_s = between(20, 200);
  machine.clearance_m = between(2e-3, 5e-3);
  machine.noise_N = between(5, 30);
  const int holes = 40;
  const int chips_at = 12 + static_cast<int>(between(0, 24));
  const double step = c.thrust_step_N * between(1, 2);
  const int pause_at = static_cast<int>(between(5, 35));
  const double end = (fate == Fate::worn ? 1.08 : 0.9) * c.thrust_limit_N;
  bool early = false, naive_early = false;  // before the level has come within 5 % of the limit
  for (int n = 0; n < holes; ++n) {
    const double age = static_cast<double>(n) / (holes - 1);
    const bool chipped = n >= chips_at;
    double level = fresh + (end - fresh) * age * age;
    if (fate == Fate::chipped) level = fresh * (1 + 0.1 * age) + (chipped ? step : 0.0);
    tool.thrust_N = level + scatter * random.next();
    if (n == pause_at) {
      machine.pause(between(60, 3000));
      run.restart();
    }
    machine.hole(tool);
    tally.square_N2 += std::pow(run.monitor->hole().thrust_N - tool.thrust_N, 2);
    ++tally.holes;
    const bool due = fate == Fate::worn      ? level >= 0.95 * c.thrust_limit_N
                     : fate == Fate::chipped ? chipped
                                             : false;
    if (!due) {
      early = early || run.alarms > 0;
      naive_early = naive_early || naive.alarm;
    }
    if (fate == Fate::chipped && n == chips_at + 2) break;  // later is too late
  }
  CHECK(run.monitor->state().holes == run.monitor->tool().holes);
  auto count = [fate](Score& score, bool right) {
    (fate == Fate::sound ? score.sound : fate == Fate::worn ? score.worn : score.chipped) += right;
  };
  const bool wanted = fate != Fate::sound;
  const bool right = !early && (run.alarms > 0) == wanted;
  count(tally.monitor, right);
  count(tally.fixed_limit, !naive_early && naive.alarm == wanted);
  if (!right) {
    const auto& t = run.monitor->tool();
    std::printf("  wrong: seed %llu, fate %d, %s %.4g over %.4g at hole %u\n",
                static_cast<unsigned long long>(seed), static_cast<int>(fate), name_of(t.rule),
                t.value, t.threshold, t.alarm_hole);
  }
}

// Taps: torque, three times the initial one; 2.5 Nm for M6. A fixed limit knows no tool of its own:
// 2.5 Nm, and 0.6 Nm for M3, three times the 0.2 Nm of a typical one.
void one_tap(std::uint64_t seed, Fate fate, Tally& tally) {
  GaussianNoise random(seed * 7919 + 17);
  auto between = [&](double a, double b) { return a + (b - a) * random.uniform(); };
  const bool large = random.uniform() < 0.5;
  WearConfig c = slow(large ? WearConfig::tap_m6() : WearConfig::tap_m3());
  c.warning_fraction = 1;
  Tool tool = tap_of(large ? 6 : 3);
  tool.chips = between(0.03, 0.15);
  tool.thrust_N = between(-100, 150);  // in the source: says nothing
  const double fresh = (large ? 0.75 : 0.2) * between(0.75, 1.3);
  const double limit = large ? std::min(2.5, 3 * fresh) : 3 * fresh;
  const double scatter = between(0.005, 0.02);
  double naive_mean = 0;
  bool naive_alarm = false, early = false, naive_early = false;
  Run<double, 1> run(c, seed);
  Machine machine(seed, c.sample_period_s, [&](double f, double x, double t, double a) {
    run.feed(f, x, t, a);
    naive_mean += c.sample_period_s / 0.1 * (t - naive_mean);
    naive_alarm = naive_alarm || (-x > 0 && naive_mean > (large ? 2.5 : 0.6));
  });
  machine.cold.spindle_Nm = between(-0.02, 0.02);
  machine.warm.spindle_Nm = between(-0.05, 0.05);
  machine.cold.inertia_kg_m2 = machine.warm.inertia_kg_m2 = between(-1e-4, 1e-4);
  machine.warming_s = between(20, 200);
  machine.noise_Nm = between(0.01, 0.05);
  const double end = (fate == Fate::worn ? 1.08 : 0.9) * limit;
  for (int n = 0; n < 50; ++n) {
    const double age = std::max(0.0, n - 9.0) / 40;  // the first ten holes are alike
    const double level = fresh + (end - fresh) * age;
    tool.torque_Nm = level * (1 + scatter * random.next());
    machine.hole(tool);
    if (fate == Fate::worn && level >= 0.95 * limit) continue;
    early = early || run.alarms > 0;
    naive_early = naive_early || naive_alarm;
  }
  CHECK(run.monitor->tool().holes == 50);
  const bool wanted = fate == Fate::worn;
  const bool right = !early && (run.alarms > 0) == wanted;
  (wanted ? tally.monitor.worn : tally.monitor.sound) += right;
  (wanted ? tally.fixed_limit.worn : tally.fixed_limit.sound) +=
      !naive_early && naive_alarm == wanted;
  if (!right) {
    const auto& t = run.monitor->tool();
    std::printf("  wrong: tap, seed %llu, %s %.4g over %.4g at hole %u\n",
                static_cast<unsigned long long>(seed), name_of(t.rule), t.value, t.threshold,
                t.alarm_hole);
  }
}

void random_tools(int tools, std::uint64_t first_seed) {
  Tally drills, taps;
  for (int n = 0; n < tools; ++n) {
    const std::uint64_t seed = first_seed + static_cast<std::uint64_t>(n);
    for (const Fate fate : {Fate::sound, Fate::worn, Fate::chipped}) one_tool(seed, fate, drills);
    for (const Fate fate : {Fate::sound, Fate::worn}) one_tap(seed, fate, taps);
  }
  const auto figure = [tools](const char* what, int monitor, int fixed_limit) {
    check::figure(what, 100.0 * monitor / tools, "%");
    check::figure("  by a fixed limit", 100.0 * fixed_limit / tools, "%");
  };
  figure("drills: sound ones without alarm", drills.monitor.sound, drills.fixed_limit.sound);
  figure("drills: worn ones found in time", drills.monitor.worn, drills.fixed_limit.worn);
  figure("drills: chipped ones found within three holes", drills.monitor.chipped,
         drills.fixed_limit.chipped);
  figure("taps: sound ones without alarm", taps.monitor.sound, taps.fixed_limit.sound);
  figure("taps: worn ones found in time", taps.monitor.worn, taps.fixed_limit.worn);
  check::figure("hole off by, rms", std::sqrt(drills.square_N2 / drills.holes), "N");
  // One in twenty may go wrong; a fixed limit loses one in seven and more.
  const int fewest = tools - tools / 20;
  for (const int right : {drills.monitor.sound, drills.monitor.worn, drills.monitor.chipped,
                          taps.monitor.sound, taps.monitor.worn})
    CHECK(right >= fewest);
  CHECK(drills.fixed_limit.worn < fewest);
}

// A light axis gives way to chips and wavers about its feed: by 8 %, of which a tenth of the mass
// reads as thrust. The hole's mean is what was put in, for wavering adds up to nothing.
void wavering_feed() {
  constexpr double kMass_kg = 150, kPeriod = 500e-6, kFeed = 0.03, kThrust_N = 300;
  WearConfig c = WearConfig::drill_6mm();
  c.sample_period_s = kPeriod;
  for (const double known_kg : {0.0, kMass_kg}) {
    c.equivalent_mass_kg = known_kg;
    Monitor monitor;
    monitor.configure(c);
    double t = 0, z = 0;
    const auto step = [&](double v, double acceleration) {
      z -= v * kPeriod;
      const double cut = z < -0.005 && v > 0 ? kThrust_N * std::min(1.0, (-0.005 - z) / 2e-3) : 0;
      // Positive against +z, and the axis goes to -z.
      const double force = -cut + 0.1 * kMass_kg * acceleration;
      monitor.process(force, -v * kPeriod, 0.8 * cut / kThrust_N, 900 * kPeriod, Quality::good);
      t += kPeriod;
    };
    for (int hole = 0; hole < 5; ++hole) {
      for (int n = 0; n < 200; ++n) step(0, 0);
      while (z > -0.025) {
        constexpr double kWaver_rad_s = kTwoPi * 17;
        step(kFeed * (1 + 0.08 * std::sin(kWaver_rad_s * t)),
             kFeed * 0.08 * kWaver_rad_s * std::cos(kWaver_rad_s * t));
      }
      while (z < 0) step(-0.5, 0);
    }
    const auto& core = monitor.core();
    CHECK(core.tool.holes == (known_kg > 0 ? 5 : 0) && core.short_cuts == (known_kg > 0 ? 0 : 5));
    if (!(known_kg > 0)) continue;
    // Half a period of the waver that is not made up for: 2 m_e v_w / time of the hole.
    const double rest = 2 * 0.1 * kMass_kg * 0.08 * kFeed / (c.shortest_m / kFeed);
    CHECK_NEAR(monitor.hole().thrust_N, kThrust_N, rest + 1);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  holes_as_put_in<double>();
  holes_as_put_in<float>();
  what_is_no_hole();
  passes();
  rules_of_the_source();
  ratios_warn_above_a_sound_tool();
  a_drop_clears_nothing();
  warming_up();
  wavering_feed();
  tools_in_turn();
  faults<double>();
  faults<float>();
  evidence<double>();
  evidence<float>();
  validation();
  random_tools(nightly ? 500 : 20, nightly ? 90000 : 50000);
  return check::done();
}
