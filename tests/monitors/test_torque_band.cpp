// Torque band monitor: revolution averages, the promise about timing (none of an admissible
// alignment alarms, whatever beyond it does), Bertok's fault (1984, fig. 5.14-5.17), overrides,
// faults, evidence, against a search over all alignments written out; misses and false alarms on
// random programs beside a fixed limit and a band without alignment. --nightly: more programs.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/monitors/torque_band.hpp"
#include "servosense/sim/gaussian_noise.hpp"

namespace {

using namespace servosense;
using Points = std::vector<TorqueBandPoint<double>>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kPeriod_s = 1e-3;
constexpr double kSpacing_s = 0.05;

/// Torque over program time, at kSpacing_s, linear between.
struct Program {
  std::vector<double> torque;
  [[nodiscard]] double at(double t) const {
    const double x = std::clamp(t / kSpacing_s, 0.0, static_cast<double>(torque.size() - 1) - 1e-9);
    const auto i = static_cast<std::size_t>(x);
    return torque[i] + (x - static_cast<double>(i)) * (torque[i + 1] - torque[i]);
  }
  [[nodiscard]] double length_s() const {
    return kSpacing_s * static_cast<double>(torque.size() - 1);
  }
};

/// The band by hand: every point looked at.
Points band_of(const Program& p, double share, double absolute_Nm, double time_s) {
  const auto n = static_cast<int>(p.torque.size());
  const int w = static_cast<int>(std::lround(time_s / kSpacing_s));
  Points out;
  for (int i = 0; i < n; ++i) {
    double low = 1e9, high = -1e9;
    for (int k = std::max(0, i - w); k <= std::min(n - 1, i + w); ++k) {
      const double t = p.torque[static_cast<std::size_t>(k)];
      low = std::min(low, t - absolute_Nm - share * t);
      high = std::max(high, t + absolute_Nm + share * t);
    }
    out.push_back({p.torque[static_cast<std::size_t>(i)], low, high});
  }
  return out;
}
template <typename Real>
std::vector<TorqueBandPoint<Real>> as(const Points& points) {
  std::vector<TorqueBandPoint<Real>> out;
  for (const auto& p : points)
    out.push_back({static_cast<Real>(p.torque_Nm), static_cast<Real>(p.lower_Nm),
                   static_cast<Real>(p.upper_Nm)});
  return out;
}

/// Cuts of random depth with air between them; entries and exits take 0.1 to 0.6 s.
Program random_program(GaussianNoise& random, double length_s) {
  auto between = [&](double a, double b) { return a + (b - a) * random.uniform(); };
  Program p;
  auto hold = [&](double level, double seconds) {
    for (int n = static_cast<int>(seconds / kSpacing_s); n > 0; --n) p.torque.push_back(level);
  };
  auto slope = [&](double to, double seconds) {
    const double from = p.torque.back();
    const int n = std::max(2, static_cast<int>(seconds / kSpacing_s));
    for (int i = 1; i <= n; ++i) p.torque.push_back(from + (to - from) * i / n);
  };
  hold(0, 2.5);
  while (static_cast<double>(p.torque.size()) * kSpacing_s < length_s) {
    slope(between(3, 20), between(0.1, 0.6));
    for (int k = static_cast<int>(between(1, 4)); k > 0; --k) {
      hold(p.torque.back(), between(0.5, 3));
      slope(between(3, 20), between(0.1, 2));
    }
    hold(p.torque.back(), between(0.5, 2));
    slope(0, between(0.1, 0.6));
    hold(0, between(0.5, 1.5));
  }
  hold(0, 2.5);
  return p;
}

TorqueBandConfig config() {
  TorqueBandConfig c;
  c.spacing = kSpacing_s;
  c.step = 0.1;
  c.max_shift = 1.0;
  c.shift_step = 0.1;
  c.max_drift = 0.02;
  return c;
}

template <typename Real>
struct Run {
  std::vector<TorqueBandPoint<Real>> points;
  std::unique_ptr<TorqueBandMonitor<Real>> monitor = std::make_unique<TorqueBandMonitor<Real>>();
  double turn_rad = 0;
  double spindle_rad_s;

  Run(const TorqueBandConfig& c, const Points& band, double spindle = rad_s_from_rpm(1500))
      : points(as<Real>(band)), spindle_rad_s(spindle) {
    CHECK(TorqueBandMonitor<Real>::validate(c).ok());
    monitor->configure(c);
    monitor->set_reference(points);
    monitor->start();
  }
  MonitorState step(double torque, double override_ = 1, Quality q = Quality::good) {
    const double turned = spindle_rad_s * kPeriod_s;
    turn_rad += turned;
    return monitor->process(static_cast<Real>(torque), static_cast<Real>(turned),
                            static_cast<Real>(kPeriod_s * override_), static_cast<Real>(override_),
                            q);
  }
  [[nodiscard]] std::uint64_t alarms() const { return monitor->state().alarms; }
};

// ---- revolutions -------------------------------------------------------------------------------

// Run-out and teeth average out at any speed; a revolution that is no whole number of samples too.
void revolutions() {
  for (const double rpm : {250.0, 1000.0, 1370.0, 9000.0, -1370.0}) {
    TurnMean<double> turns;
    const double step = rad_s_from_rpm(rpm) / 8000;
    const double per_turn = kTwoPi / std::abs(step);
    double angle = 0.3, worst = 0, naive = 0, samples = 0, sum = 0, count = 0;
    int complete = 0;
    for (int n = 0; n < 40000; ++n) {
      angle += step;
      const double torque = 10 + 3 * std::sin(angle) + 2 * std::sin(4 * angle + 1);
      sum += torque;
      ++count;
      if (!turns.add(torque, step)) continue;
      ++complete;
      if (complete > 1) {
        worst = std::max(worst, std::abs(turns.mean() - 10));
        naive = std::max(naive, std::abs(sum / count - 10));
      }
      sum = count = 0;
      samples += turns.samples();
      turns.next();
    }
    CHECK_NEAR(complete, 40000 / per_turn, 1.01);
    CHECK_NEAR(samples, complete * per_turn, 1e-6 * 40000);
    // Rectangles instead of the integral: an end may miss half a sample of slope twice.
    CHECK(worst <= 0.5 * (3 + 8) * std::abs(step) / per_turn + 1e-9);
    if (rpm == 9000) {
      check::figure("revolution mean of 53.3 samples, off by", worst, "Nm");
      check::figure("  in whole samples", naive, "Nm");
      CHECK(worst < 0.3 * naive);
    }
  }
}

// ---- timing ------------------------------------------------------------------------------------

struct Timing {
  double shift_s = 0;      ///< measured comes so much later
  double drift = 0;        ///< and more so with time
  double turn_at_s = 1e9;  ///< where the drift changes its sign
};

template <typename Real>
std::uint64_t run_program(const TorqueBandConfig& c, const Program& p, const Points& band,
                          const Timing& timing, double* value = nullptr) {
  Run<Real> run(c, band);
  double shift = timing.shift_s, worst = 0;
  for (double t = 0; t < p.length_s(); t += kPeriod_s) {
    shift += (t < timing.turn_at_s ? 1 : -1) * timing.drift * kPeriod_s;
    run.step(p.at(t - shift));
    worst = std::max(worst, static_cast<double>(run.monitor->core().value));
  }
  if (value != nullptr) *value = worst;
  return run.alarms();
}

// Tolerance in time 1.5 grid steps, half a step and a spacing; in magnitude none but rounding.
// Whatever the shift and drift within their bounds, nothing is ever outside; beyond them it is.
void promise() {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    GaussianNoise random(seed);
    const Program p = random_program(random, 30);
    const TorqueBandConfig c = config();
    const Points band = band_of(p, 0, 1e-3, 0.25);
    Timing t;
    t.drift = (2 * random.uniform() - 1) * 0.02;
    t.turn_at_s = 5 + 20 * random.uniform();
    // Course within +-max_shift.
    const double half = std::abs(t.drift) * 30;
    t.shift_s = (2 * random.uniform() - 1) * (1 - half);
    double value = 0;
    const bool quiet = run_program<double>(c, p, band, t, &value) == 0 && value == 0;
    const std::string what = "timing within bounds, seed " + std::to_string(seed);
    check::that(quiet, what.c_str(), __FILE__, __LINE__);
    Timing far{random.uniform() < 0.5 ? -1.6 : 1.6, 0, 1e9};
    check::that(run_program<double>(c, p, band, far) == 1, (what + ", then beyond").c_str(),
                __FILE__, __LINE__);
    // A program that runs a tenth slower than it says.
    check::that(run_program<double>(c, p, band, {0, 0.1, 1e9}) == 1, (what + ", slow").c_str(),
                __FILE__, __LINE__);
  }
}

// The shift itself, as reported, over a program of which it is known.
void finds_the_shift() {
  double worst = 0;
  for (const double shift : {-0.8, -0.35, 0.0, 0.2, 0.75}) {
    GaussianNoise random(77);
    const Program p = random_program(random, 40);
    Run<double> run(config(), band_of(p, 0.15, 0.5, 0.3));
    for (double t = 0; t < 35; t += kPeriod_s)
      run.step(1.05 * p.at(t - shift) + 0.3 * random.next());
    CHECK(run.alarms() == 0);
    worst = std::max(worst, std::abs(run.monitor->core().shift + shift));
  }
  check::figure("shift off by, at most", worst, "s");
  CHECK(worst <= 0.1);  // a grid step
}

// J against a search over all courses of the shift, forwards over every start, written out.
void least_of_all_courses() {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    GaussianNoise random(seed + 300);
    const Program p = random_program(random, 12);
    TorqueBandConfig c = config();
    c.max_shift = 0.2;
    c.shift_step = 0.1;
    c.max_drift = 0.01;
    c.memory_steps = 50;
    c.alarm_steps = 20;
    const Points band = band_of(p, 0.1, 0.2, 0.05);
    Run<double> run(c, band);
    std::vector<std::array<double, 5>> z;  // of each step and shift
    std::vector<bool> moves;
    double slack = 0.05;
    std::uint64_t steps = 0;
    for (double t = 0; t < p.length_s() - 1; t += kPeriod_s) {
      run.step(p.at(t + 0.15) * (1 + 0.1 * std::sin(t)));
      if (run.monitor->state().steps == steps) continue;
      steps = run.monitor->state().steps;
      const auto& in = run.monitor->core().in;
      const double middle = in.cell * kSpacing_s + in.within;
      slack += 0.01 * in.progress;
      moves.push_back(slack >= 0.1);
      if (moves.back()) slack -= 0.1;
      z.emplace_back();
      for (int k = 0; k < 5; ++k) {
        const double x = (middle + (k - 2) * 0.1) / kSpacing_s;
        const double i = std::floor(x + 1e-9);
        auto point = [&](double j) {
          return band[static_cast<std::size_t>(
              std::clamp(j, 0.0, static_cast<double>(band.size() - 1)))];
        };
        const double low = std::min(point(i).lower_Nm, point(i + 1).lower_Nm);
        const double high = std::max(point(i).upper_Nm, point(i + 1).upper_Nm);
        const double over = std::max({0.0, in.mean_Nm - high, low - in.mean_Nm});
        z.back()[static_cast<std::size_t>(k)] = std::min(1.0, over / ((high - low) / 8));
      }
    }
    // Depth first over the moves; between them the shift stands.
    double least = 1e9;
    auto walk = [&](auto&& self, std::size_t n, int k, double j) -> void {
      for (; n < z.size(); ++n) {
        if (moves[n])
          for (const int d : {-1, 1})
            if (k + d >= 0 && k + d < 5) {
              const double moved = (1 - 1 / 50.0) * j + z[n][static_cast<std::size_t>(k + d)];
              self(self, n + 1, k + d, moved);
            }
        j = (1 - 1 / 50.0) * j + z[n][static_cast<std::size_t>(k)];
      }
      least = std::min(least, j);
    };
    for (int k = 0; k < 5; ++k) walk(walk, 0, k, 0.0);
    CHECK(z.size() > 80);
    const std::string what = "least of all courses, seed " + std::to_string(seed);
    check::near(run.monitor->core().value, least, 1e-6, what.c_str(), __FILE__, __LINE__);
  }
}

// ---- the source's fault, overrides, holds, the end ---------------------------------------------

void increasing_depth() {
  // 250 rpm, constant radial depth predicted, growing depth cut.
  Program p;
  for (int i = 0; i < 600; ++i) p.torque.push_back(i < 60 || i > 540 ? 0 : 4.0);
  TorqueBandConfig c = config();
  c.step = 0.24;
  for (const double growth : {0.0, 0.02, 0.05}) {
    Run<double> run(c, band_of(p, 0.15, 0.3, 0.4), rad_s_from_rpm(250));
    double alarm_at = -1;
    for (double t = 0; t < p.length_s(); t += kPeriod_s) {
      const double torque = p.at(t) * (1 + growth * std::max(0.0, t - 3)) *
                            (1 + 0.2 * std::sin(run.turn_rad) + 0.3 * std::sin(6 * run.turn_rad));
      if (run.step(torque) == MonitorState::alarm && alarm_at < 0) alarm_at = t;
    }
    if (growth == 0) {
      CHECK(run.alarms() == 0 && alarm_at < 0);
    } else {
      // Limit: 4 (1 + 0.15) + 0.3 Nm, reached at 0.225 / growth.
      const double due = 3 + 0.225 / growth;
      CHECK_BETWEEN(alarm_at, due, due + 3.5);
      CHECK(run.monitor->core().measured_Nm > run.monitor->core().upper_Nm || alarm_at < 26);
    }
  }
}

void overrides_and_holds() {
  GaussianNoise random(5);
  const Program p = random_program(random, 30);
  const Points band = band_of(p, 0.12, 0.3, 0.3);
  // Torque law a f + b: 85 % with the feed, 15 % of edges (Bertok 1984, eq. 4.1).
  auto drive = [&](bool reported) {
    Run<double> run(config(), band);
    double at = 0;
    for (int n = 0; at < p.length_s(); ++n) {
      const double t = n * kPeriod_s;
      const double o = t < 6 ? 1 : t < 12 ? 0.5 : t < 14 ? 0 : t < 22 ? 1.2 : 0.7;
      at += o * kPeriod_s;
      const double torque = o > 0 ? p.at(at) * (0.85 * o + 0.15) : 0.0;
      run.step(torque, reported ? o : 1);
    }
    return run.alarms();
  };
  CHECK(drive(true) == 0);
  CHECK(drive(false) >= 1);

  // At the end, and before the start: idle; a second workpiece starts anew.
  Run<double> run(config(), band);
  for (double t = 0; t < p.length_s() + 2; t += kPeriod_s) run.step(p.at(t));
  CHECK(run.monitor->state().state == MonitorState::idle);
  for (int n = 0; n < 3000; ++n) CHECK(run.step(30) == MonitorState::idle);
  run.monitor->start();
  CHECK(run.monitor->state().state == MonitorState::learning);
  for (double t = 0; t < p.length_s(); t += kPeriod_s) run.step(0.4 * p.at(t));
  CHECK(run.alarms() == 1);

  // A spindle that has stopped while the program goes on.
  Run<double> stopped(config(), band);
  for (double t = 0; t < 12; t += kPeriod_s) {
    if (t > 4) stopped.spindle_rad_s = 0;
    stopped.step(t > 4 ? 0 : p.at(t));
  }
  // What its observer reads then is friction, of which nothing is expected.
  CHECK(stopped.alarms() == 0 && stopped.monitor->state().state == MonitorState::idle);

  // Air level of 0.4 Nm: too much for a band of 0.3 Nm, learned while all is air.
  for (const bool learns : {true, false}) {
    TorqueBandConfig c = config();
    c.air_limit_Nm = learns ? 0.6 : 0.0;
    Run<double> shifted(c, band_of(p, 0.02, 0.3, 0.3));
    double off = 0;
    for (double t = 0; t < p.length_s(); t += kPeriod_s) {
      off = 0.4 * std::min(1.0, t / 2);
      shifted.step(p.at(t) + off);
    }
    CHECK((shifted.alarms() == 0) == learns);
    if (learns) CHECK_NEAR(shifted.monitor->core().air_Nm, 0.4, 0.1);
  }
}

// ---- faults, evidence --------------------------------------------------------------------------

template <typename Real>
void faults() {
  struct Fault {
    Quality quality;
    double value;
    int length;
    MonitorState says;
  };
  const MonitorState wrong = MonitorState::signal_fault, new_start = MonitorState::learning;
  const Fault kinds[] = {{Quality::good, kNan, 1, wrong},
                         {Quality::good, -std::numeric_limits<double>::infinity(), 5, wrong},
                         {Quality::good, 1e20, 3, wrong},
                         {Quality::missing, 900, 8, wrong},
                         {Quality::stuck, 900, 900, wrong},
                         {Quality::jump, -900, 1, wrong},
                         {Quality::gap | Quality::missing, 900, 700, wrong},
                         {Quality::restarted, 900, 1, new_start},
                         {Quality::settling, 900, 60, new_start}};
  GaussianNoise random(9);
  const Program p = random_program(random, 14);
  const Points band = band_of(p, 0.1, 0.3, 0.3);
  for (const Fault& fault : kinds) {
    for (int at = 0; at < 14000; at += 1171) {
      Run<Real> run(config(), band);
      bool flagged = true;
      for (int n = 0; n < 19000; ++n) {
        const bool bad = n >= at && n < at + fault.length;
        const MonitorState s = run.step(bad ? fault.value : p.at(n * kPeriod_s), 1,
                                        bad ? fault.quality : Quality::good);
        if (bad) flagged = flagged && s == fault.says;
        flagged = flagged && s != MonitorState::alarm && s != MonitorState::warning;
        // Armed again: a revolution, a step that may not be steady, the step and the one behind it.
        if (n > at + fault.length + 600 && n < 14000) flagged = flagged && s == MonitorState::armed;
      }
      CHECK(flagged && run.alarms() == 0);
    }
  }
  // Not deaf afterwards.
  Run<Real> run(config(), band);
  for (int n = 0; n < 14000; ++n)
    run.step(n < 4000 ? p.at(n * kPeriod_s) : 40, 1,
             n % 500 == 0 ? Quality::missing : Quality::good);
  CHECK(run.alarms() >= 1);
}

template <typename Real>
void evidence() {
  GaussianNoise random(21);
  const Program p = random_program(random, 25);
  Run<Real> run(config(), band_of(p, 0.1, 0.3, 0.3));
  CHECK(run.monitor->evidence().count == 0);
  TorqueBandMonitor<Real>* m = run.monitor.get();
  typename TorqueBandMonitor<Real>::Core at_alarm;
  for (double t = 0; t < 25; t += kPeriod_s) {
    const auto before = m->state().alarms;
    run.step(p.at(t - 0.3) * (t > 12 ? 1.5 : 1) + 0.1 * random.next());
    if (m->state().alarms > before) at_alarm = m->core();
  }
  CHECK(run.alarms() == 1);
  const auto e = m->evidence();
  CHECK(e.count > 0);
  const auto core = m->replay(e);
  CHECK(core.alarm.state().state == MonitorState::alarm);
  CHECK(std::memcmp(&core.outside, &at_alarm.outside, sizeof core.outside) == 0);
  CHECK(std::memcmp(&core.value, &at_alarm.value, sizeof core.value) == 0);
  CHECK(core.shift == at_alarm.shift && core.measured_Nm == at_alarm.measured_Nm);
  static_assert(std::is_trivially_copyable_v<typename TorqueBandMonitor<Real>::Core>);
}

// Eight hours of program time in float: position to half a point.
void long_program() {
  TorqueBandConfig c = config();
  c.spacing = 1;
  c.step = 10;
  c.max_shift = 20;
  c.shift_step = 10;
  std::vector<TorqueBandPoint<float>> points(28'800, {1, 0, 2});
  TorqueBandMonitor<float> m;
  CHECK(TorqueBandMonitor<float>::validate(c).ok());
  m.configure(c);
  m.set_reference(points);
  m.start();
  for (int n = 0; n < 28'000'000; ++n) m.process(1.0F, 0.1F, 1e-3F, 1.0F, Quality::good);
  // 1e-3 in float is 1 + 4.7e-8 of it; sums below one point round by 6e-8 at most, 1000 times.
  // The position goes on step by step.
  CHECK_NEAR(m.cell(), 27'995.0, 7.0);
  CHECK(m.state().state == MonitorState::armed);
}

void validation() {
  struct Case {
    const char* parameter;
    void (*spoil)(TorqueBandConfig&);
  };
  const Case cases[] = {
      {"spacing", [](TorqueBandConfig& c) { c.spacing = 0; }},
      {"step", [](TorqueBandConfig& c) { c.step = kNan; }},
      {"max_shift", [](TorqueBandConfig& c) { c.max_shift = -1; }},
      {"shift_step", [](TorqueBandConfig& c) { c.shift_step = 0.01; }},
      {"max_drift", [](TorqueBandConfig& c) { c.max_drift = 1; }},
      {"memory_steps", [](TorqueBandConfig& c) { c.memory_steps = 0; }},
      {"alarm_steps", [](TorqueBandConfig& c) { c.alarm_steps = 150; }},
      {"air_limit_Nm", [](TorqueBandConfig& c) { c.air_limit_Nm = -1; }},
      {"tolerated_stand_ins", [](TorqueBandConfig& c) { c.tolerated_stand_ins = 1; }},
      {"warning_fraction", [](TorqueBandConfig& c) { c.warning_fraction = 2; }},
  };
  for (const Case& k : cases) {
    TorqueBandConfig c = config();
    CHECK(TorqueBandMonitor<double>::validate(c).ok());
    k.spoil(c);
    CHECK_TEXT(TorqueBandMonitor<double>::validate(c).parameter(), k.parameter);
  }
  // Without a reference, or without a start, it idles.
  TorqueBandMonitor<double> m;
  m.configure(config());
  m.start();
  for (int n = 0; n < 100; ++n)
    CHECK(m.process(5, 0.1, 1e-3, 1, Quality::good) == MonitorState::idle);
}

// ---- misses and false alarms -------------------------------------------------------------------

enum class Fate {
  sound,
  missing_tool,
  wrong_tool,
  extra_stock,
  growing_depth,
  weak_tool,
  weak_stock
};
constexpr std::array<const char*, 7> kFates = {"sound runs without alarm",
                                               "missing tool found",
                                               "wrong tool found",
                                               "extra stock found",
                                               "growing depth found",
                                               "wrong tool, 20 to 40 % off, found",
                                               "extra stock of 15 to 40 % found"};

/// Right answers: this monitor, a fixed limit, the same band without alignment.
struct Tally {
  std::array<int, 7> monitor{}, fixed_limit{}, unaligned{};
};

void one_program(std::uint64_t seed, Tally& tally) {
  for (std::size_t f = 0; f < kFates.size(); ++f) {
    const Fate fate = static_cast<Fate>(f);
    GaussianNoise random(seed);
    auto between = [&](double a, double b) { return a + (b - a) * random.uniform(); };
    const Program p = random_program(random, 30);
    const Points band = band_of(p, 0.15, 0.5, 0.3);
    const double highest = *std::max_element(p.torque.begin(), p.torque.end());
    // Material, sharpness; a late start; a clock or a drive that is a little off; run-out and
    // teeth.
    const double gain = between(0.92, 1.08);
    double shift = between(-0.5, 0.5), drift = between(-0.012, 0.012);
    const double run_out = between(0, 0.2), teeth = between(0, 0.3), noise = between(0.1, 1.5);
    const int z = 2 + static_cast<int>(between(0, 5));
    double o = 1, change_at = between(3, 10);
    const double fault_from = between(0.1, 0.5) * p.length_s();
    const double fault_to = fault_from + between(4, 10);
    const double wrong = random.uniform() < 0.5 ? between(0.4, 0.65) : between(1.5, 2.2);
    const double extra = between(0.4, 1.0) * highest;
    const double weak_tool = random.uniform() < 0.5 ? between(0.6, 0.8) : between(1.2, 1.4);
    const double weak_stock = between(0.15, 0.4) * highest;
    Run<float> run(config(), band, rad_s_from_rpm(between(600, 3000)));
    TurnMean<double> turns;
    double at = 0;
    int unaligned_row = 0;
    bool fixed = false, unaligned = false;
    for (int n = 0; at < p.length_s(); ++n) {
      const double t = n * kPeriod_s;
      if (t >= change_at) {  // somebody turns the override
        o = between(0.6, 1.2);
        change_at = t + between(3, 10);
      }
      at += o * kPeriod_s;
      if (random.uniform() < 1e-4) drift = between(-0.012, 0.012);
      shift += drift * o * kPeriod_s;
      double m = p.at(at - shift) * gain;
      if (fate == Fate::missing_tool) m = 0;
      if (fate == Fate::wrong_tool) m *= wrong;
      if (fate == Fate::extra_stock && at > fault_from && at < fault_to) m += extra;
      if (fate == Fate::weak_tool) m *= weak_tool;
      if (fate == Fate::weak_stock && at > fault_from && at < fault_to) m += weak_stock;
      if (fate == Fate::growing_depth) m *= 1 + 0.03 * at;
      m *= 0.85 * o + 0.15;
      m *= 1 + run_out * std::sin(run.turn_rad) + teeth * std::sin(z * run.turn_rad);
      m += noise * random.next();
      run.step(m, o);
      if (!turns.add(m, run.spindle_rad_s * kPeriod_s) || turns.samples() < 100) continue;
      const double mean = turns.mean();
      turns.next();
      fixed = fixed || mean > 1.25 * highest;
      const auto i = std::min(static_cast<std::size_t>(at / kSpacing_s), band.size() - 1);
      const double low = band[i].lower_Nm - (o < 1 ? (1 - o) * band[i].torque_Nm : 0);
      const double high = band[i].upper_Nm * std::max(1.0, o);
      unaligned_row = mean < low || mean > high ? unaligned_row + 1 : 0;
      unaligned = unaligned || unaligned_row >= 3;
    }
    const bool wanted = fate != Fate::sound;
    const bool right = (run.alarms() > 0) == wanted;
    tally.monitor[f] += right;
    tally.fixed_limit[f] += fixed == wanted;
    tally.unaligned[f] += unaligned == wanted;
    if (!right && fate < Fate::weak_tool)
      std::printf("  wrong: seed %llu, %s\n", static_cast<unsigned long long>(seed), kFates[f]);
  }
}

void random_programs(int programs, std::uint64_t first_seed) {
  Tally tally;
  for (int n = 0; n < programs; ++n) one_program(first_seed + static_cast<std::uint64_t>(n), tally);
  for (std::size_t f = 0; f < kFates.size(); ++f) {
    check::figure(kFates[f], 100.0 * tally.monitor[f] / programs, "%");
    check::figure("  by a fixed limit", 100.0 * tally.fixed_limit[f] / programs, "%");
    check::figure("  by the band without alignment", 100.0 * tally.unaligned[f] / programs, "%");
    if (f < 5) CHECK(tally.monitor[f] >= programs - programs / 20);  // the weak ones are shown
  }
  CHECK(tally.unaligned[0] < tally.monitor[0] - programs / 5);  // alignment is worth its while
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  revolutions();
  promise();
  finds_the_shift();
  least_of_all_courses();
  increasing_depth();
  overrides_and_holds();
  faults<double>();
  faults<float>();
  evidence<double>();
  evidence<float>();
  long_program();
  validation();
  random_programs(nightly ? 500 : 20, nightly ? 70000 : 40000);
  return check::done();
}
