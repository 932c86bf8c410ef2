// Tooth breakage monitor: averaged sequences of the study, threshold over the swept angle, random
// simulated cuts beside fixed limits, faults, teaching, run-out, replay of an alarm.
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
#include "servosense/monitors/tooth_breakage.hpp"
#include "servosense/sim/gaussian_noise.hpp"
#include "servosense/sim/milling_simulator.hpp"
#include "servosense/sim/run_parallel.hpp"

namespace {

using servosense::Engagement;
using servosense::GaussianNoise;
using servosense::kPi;
using servosense::kTwoPi;
using servosense::MillingDirection;
using servosense::MillingSimulation;
using servosense::MillingSimulator;
using servosense::MillingStart;
using servosense::MillingStep;
using servosense::MonitorState;
using servosense::Quality;
using servosense::SignalState;
using servosense::ToothBreakageConfig;
using servosense::ToothBreakageMonitor;

constexpr double kPeriod = 125e-6;

template <typename Real>
using Monitor = ToothBreakageMonitor<Real>;

double degrees(double angle) { return angle * kPi / 180; }

// ---------------------------------------------------------------------------------------------
// Random cuts from the milling simulator.

enum class Event { steady, entry, exit, slot, hole, feed, speed, hold, depth };
constexpr std::array<const char*, 9> kEvents = {"steady", "entry", "exit", "slot", "hole",
                                                "feed",   "speed", "hold", "depth"};
enum class Breaking { none, chipped, broken };

struct Recording {
  unsigned teeth = 0;
  double noise = 0;  // of a sample of force
  double torque_noise = 0;
  double mean_force = 0;  // of the steady cut
  double mean_torque = 0;
  double swept_deg = 0;
  double load = 1;  // greatest tooth-period mean after the break, over the mean
  double break_s = -1;
  double tooth_s = 0;
  std::string text;
  std::vector<double> fx, fy, torque, x, y, angle, increment;
};

struct Choice {
  Event event = Event::steady;
  Breaking breaking = Breaking::none;
  bool flexible = false;
  double throw_part = 0.1;  // greatest difference between two teeth, of the feed per tooth
};

Recording simulate(std::uint64_t seed, const Choice& choice) {
  GaussianNoise random(seed);
  const auto between = [&](double low, double high) {
    return low + (high - low) * random.uniform();
  };
  const auto log_between = [&](double low, double high) {
    return low * std::pow(high / low, random.uniform());
  };
  MillingSimulation m;
  m.tool.teeth = 2 + static_cast<int>(random.uniform() * 7);
  const bool face = random.uniform() < 0.3;
  const double radius = face ? log_between(20e-3, 60e-3) : log_between(4e-3, 16e-3);
  m.tool.diameter_m = 2 * radius;
  m.tool.helix_deg = face ? 0 : between(0, 45);
  m.tool.force.tangential_coefficient_N_per_m2 = log_between(6e8, 3e9);
  m.tool.force.radial_ratio = between(0.2, 0.6);
  m.tool.force.tangential_edge_N_per_m = between(0, 20e3);
  m.tool.force.radial_edge_N_per_m = between(0, 20e3);
  m.tool.force.size_effect_exponent = between(0, 0.3);
  const double feed = face ? between(0.1e-3, 0.3e-3) : between(0.04e-3, 0.2e-3);
  m.cut.feed_per_tooth_m = feed;
  m.cut.axial_depth_m = face ? between(1e-3, 4e-3) : radius * between(0.2, 1.5);
  const double immersion = random.uniform() < 0.2 ? 1.0 : between(0.04, 1.0);
  m.cut.radial_immersion_m = immersion * m.tool.diameter_m;
  m.cut.direction = immersion >= 1           ? MillingDirection::slot
                    : random.uniform() < 0.5 ? MillingDirection::up
                                             : MillingDirection::down;
  // Two servo samples a quarter tooth at least.
  const double fastest = 60 / (8.0 * m.tool.teeth * kPeriod);
  m.cut.spindle_speed_rpm = log_between(face ? 400 : 1500, std::min(fastest, 12000.0));
  for (int i = 0; i < m.tool.teeth; ++i)
    m.tool.throw_m.push_back(choice.throw_part * feed * random.uniform());
  const double tooth_s = 60 / (m.cut.spindle_speed_rpm * m.tool.teeth);
  const double speed = m.cut.spindle_speed_rpm * kTwoPi / 60;

  // Straight faces, slots and holes no closer than the steps that a cutter of this feed resolves.
  const double turn_m = feed * m.tool.teeth;
  const double length = 30 * turn_m;
  m.start_position_m = 3 * m.tool.diameter_m;
  double revolutions = 40;
  double event_m = m.start_position_m + length;  // of the tool axis
  switch (choice.event) {
    case Event::entry:
      m.start = MillingStart::entry;
      m.clearance_m = (m.tool.teeth + 12) * feed;
      revolutions = std::min(60.0, 25 + radius / turn_m);
      break;
    case Event::exit:
      m.workpiece.length_m = event_m;
      // Starts before the leading edge comes out.
      m.start_position_m = event_m - radius - 15 * turn_m;
      revolutions = std::min(120.0, 40 + 2 * radius / turn_m);
      break;
    case Event::slot: {
      const double width = log_between(0.1, 2) * radius;
      const double from = m.start_position_m + radius + 15 * turn_m;
      m.workpiece.slots.push_back({from, from + width});
      revolutions = std::min(200.0, 40 + (2 * radius + width) / turn_m);
      break;
    }
    case Event::hole: {
      const double hole = log_between(0.1, 1) * radius;
      const double from = m.start_position_m + radius + 15 * turn_m;
      m.workpiece.holes.push_back({from + hole, between(-1, 1) * radius, hole});
      revolutions = std::min(200.0, 40 + (2 * radius + 2 * hole) / turn_m);
      break;
    }
    case Event::depth:
      m.workpiece.length_m = m.start_position_m + 200 * turn_m;
      m.workpiece.front_depth_m = m.cut.axial_depth_m * between(0.2, 1);
      m.workpiece.far_depth_m = m.cut.axial_depth_m * between(1, 1.5);
      break;
    default:
      break;
  }
  if (choice.event == Event::hold || choice.event == Event::feed)
    revolutions = std::max(revolutions, 2.5 / (tooth_s * m.tool.teeth));
  const double duration = revolutions * m.tool.teeth * tooth_s;
  // The profile of speed and feed.
  const double at = between(0.3, 0.6) * duration;
  // No feed drive changes its speed faster.
  const double ramp = std::max(log_between(0.02, 0.5), tooth_s * m.tool.teeth);
  const double held = between(0.0, 0.3);
  const double factor = random.uniform() < 0.5 ? between(0.3, 0.8) : between(1.2, 1.8);
  const double turned = between(0.7, 1.2);
  Recording r;
  double break_turn = between(0.55, 0.8) * revolutions;
  // Exit: from before the leading edge comes out to when half the cutter has. Hold: before it.
  if (choice.event == Event::exit)
    break_turn = 10 + between(0, 1) * (10 + std::min(2 * radius / turn_m, 60.0));
  if (choice.event == Event::hold) break_turn = at / (m.tool.teeth * tooth_s) * between(0.7, 1);
  if (choice.breaking != Breaking::none) {
    r.break_s = break_turn * m.tool.teeth * tooth_s;
    const int tooth = 1 + static_cast<int>(random.uniform() * m.tool.teeth);
    m.breaks.push_back({r.break_s, std::min(tooth, m.tool.teeth),
                        choice.breaking == Breaking::broken ? 1.0 : 0.6});
  }
  if (choice.flexible) {
    const double tooth_hz = 1 / tooth_s;
    // Stiff enough for a stable cut: depth well below the lobes' lower limit.
    const double k = m.tool.force.tangential_coefficient_N_per_m2 * m.cut.axial_depth_m;
    for (auto* axis : {&m.structure.x, &m.structure.y}) {
      servosense::StructuralMode mode;
      mode.natural_frequency_hz = std::clamp(between(1.5, 6) * tooth_hz, 200.0, 3000.0);
      mode.damping_ratio = between(0.02, 0.06);
      const double omega = mode.natural_frequency_hz * kTwoPi;
      const double stiffness = k * m.tool.teeth / (mode.damping_ratio * between(0.5, 2));
      mode.modal_mass_kg = stiffness / (omega * omega);
      axis->push_back(mode);
    }
  }
  m.start_angle_rad = between(0, kTwoPi);
  // 90 steps a tooth, and a whole number a servo period.
  const int steps = std::max(1, static_cast<int>(std::ceil(kPeriod / (tooth_s / 90))));
  m.step_s = kPeriod / steps;
  m.layers = m.tool.helix_deg > 0 ? 12 : 1;
  m.surface_points = 1024;

  const double offset = between(0, kTwoPi);
  auto made = MillingSimulator::create(m);
  if (!made) {
    r.text = made.error().sentence;
    return r;
  }
  auto& sim = *made;
  r.teeth = static_cast<unsigned>(m.tool.teeth);
  r.tooth_s = tooth_s;
  r.swept_deg = servosense::engagement_of(m.tool, m.cut).swept_rad() * 180 / kPi;
  const auto samples = static_cast<std::size_t>(duration / kPeriod);
  double last_angle = m.start_angle_rad;
  for (std::size_t n = 0; n < samples; ++n) {
    const double t = static_cast<double>(n) * kPeriod;
    const double through = std::clamp((t - at) / ramp, 0.0, 1.0);
    double v = speed;
    double f = feed / tooth_s;
    if (choice.event == Event::speed) {
      v *= 1 + (turned - 1) * through;
      f *= v / speed;
    } else if (choice.event == Event::feed) {
      f *= 1 + (factor - 1) * through;
    } else if (choice.event == Event::hold) {
      const double back = std::clamp((t - at - held - ramp) / ramp, 0.0, 1.0);
      f *= 1 - through + back;
    }
    double fx = 0, fy = 0, torque = 0;
    for (int i = 0; i < steps; ++i) {
      const MillingStep& s = sim.step(v, f);
      fx += s.fx_N;
      fy += s.fy_N;
      torque += s.torque_Nm;
    }
    const MillingStep& s = sim.now();
    r.fx.push_back(fx / steps);
    r.fy.push_back(fy / steps);
    r.torque.push_back(torque / steps);
    r.x.push_back(s.x_m);
    r.y.push_back(s.y_m);
    // Means over the servo period belong to its middle.
    const double middle = 0.5 * (last_angle + s.angle_rad) + offset;
    r.angle.push_back(middle - kTwoPi * std::floor(middle / kTwoPi));
    r.increment.push_back(s.angle_rad - last_angle);
    last_angle = s.angle_rad;
  }
  if (sim.lost()) {
    r.text = "lost";
    r.teeth = 0;
    return r;
  }
  // Level of the cut: median would do as well; here the largest revolution mean before the break.
  const auto turn = static_cast<std::size_t>(m.tool.teeth * tooth_s / kPeriod);
  const std::size_t until = r.break_s > 0 ? static_cast<std::size_t>(r.break_s / kPeriod) : samples;
  for (std::size_t n = 0; n + turn <= until; n += turn) {
    double x = 0, y = 0, q = 0;
    for (std::size_t i = n; i < n + turn; ++i) {
      x += r.fx[i];
      y += r.fy[i];
      q += r.torque[i];
    }
    const auto d = static_cast<double>(turn);
    r.mean_force = std::max(r.mean_force, std::hypot(x, y) / d);
    r.mean_torque = std::max(r.mean_torque, q / d);
  }
  // What is cut in the revolution after the break: a tooth lost in the air is nobody's to find.
  if (r.break_s > 0) {
    double x = 0, y = 0, q = 0;
    for (std::size_t i = until; i < std::min(samples, until + turn); ++i) {
      x += r.fx[i];
      y += r.fy[i];
      q += r.torque[i];
    }
    const auto d = static_cast<double>(turn);
    r.load = std::min(std::hypot(x, y) / d / r.mean_force, q / d / r.mean_torque);
  }
  r.noise = between(0.02, 0.08) * r.mean_force;
  r.torque_noise = between(0.02, 0.08) * r.mean_torque;
  GaussianNoise noise(seed ^ 0x5eed);
  for (std::size_t n = 0; n < samples; ++n) {
    r.fx[n] += r.noise * noise.next();
    r.fy[n] += r.noise * noise.next();
    r.torque[n] += r.torque_noise * noise.next();
  }
  r.text = std::string(kEvents[static_cast<std::size_t>(choice.event)]) + " seed " +
           std::to_string(seed) + " teeth " + std::to_string(m.tool.teeth) + " swept " +
           std::to_string(r.swept_deg) + " helix " + std::to_string(m.tool.helix_deg) + " rpm " +
           std::to_string(m.cut.spindle_speed_rpm);
  return r;
}

enum class Signal { force, torque, drive };

struct Outcome {
  bool valid = false;
  bool false_alarm = false;
  bool found = false;
  double delay_teeth = 0;
  double score = 0;       // monitor: largest value where it counts
  double raw = 0;         // largest |force| over the mean of the cut
  double difference = 0;  // largest first difference over the mean of the cut
  double mean = 0;        // of the cut, N or Nm
};

ToothBreakageConfig config_for(const Recording& r, Signal signal) {
  ToothBreakageConfig c;
  c.teeth = r.teeth;
  c.torque = signal == Signal::torque;
  const double sample = c.torque ? r.torque_noise : r.noise;
  c.sample_noise = (c.torque ? 1 : std::sqrt(2.0)) * sample;
  c.noise = sample / std::sqrt(r.tooth_s / kPeriod);
  return c;
}

Outcome watch(const Recording& r, Signal signal) {
  Outcome o;
  if (r.teeth == 0 || r.load < 0.6) return o;
  o.valid = true;
  auto monitor = std::make_unique<Monitor<float>>();
  const auto c = config_for(r, signal);
  CHECK_TEXT(Monitor<float>::validate(c).reason(), "");
  monitor->configure(c);
  const double mean = signal == Signal::torque ? r.mean_torque : r.mean_force;
  o.mean = mean;
  const double limit_s = (r.teeth + 3) * r.tooth_s;
  std::uint64_t alarms = 0;
  double fx = 0, fy = 0;
  // Drive: the observer's first-order low-pass at half the tooth frequency and above it.
  const double pole = std::exp(-kTwoPi * kPeriod * 1.0 / r.tooth_s);
  for (std::size_t n = 0; n < r.fx.size(); ++n) {
    const double t = static_cast<double>(n + 1) * kPeriod;
    const auto angle = static_cast<float>(r.angle[n]);
    const auto increment = static_cast<float>(r.increment[n]);
    double x = r.fx[n], y = r.fy[n];
    if (signal == Signal::drive) {
      fx = pole * fx + (1 - pole) * x;
      fy = pole * fy + (1 - pole) * y;
      x = fx;
      y = fy;
    }
    if (signal == Signal::torque) {
      x = r.torque[n];
      y = 0;
      monitor->process(static_cast<float>(x), angle, increment, Quality::good);
    } else {
      monitor->process(static_cast<float>(x), static_cast<float>(y), angle, increment,
                       Quality::good);
    }
    const auto& core = monitor->core().state();
    const bool intact = r.break_s < 0 || t < r.break_s;
    const bool counts = r.break_s < 0 || (t >= r.break_s && t < r.break_s + limit_s);
    if (core.signal == SignalState::good && core.parts > 0) {
      const auto value = static_cast<double>(core.value);
      if (counts) {
        o.score = std::max(o.score, value);
        o.raw = std::max(o.raw, std::hypot(x, y) / mean);
        o.difference = std::max(o.difference, static_cast<double>(core.difference) / mean);
      }
    }
    if (monitor->state().alarms != alarms) {
      alarms = monitor->state().alarms;
      if (intact) {
        o.false_alarm = true;
      } else if (!o.found) {
        o.delay_teeth = (t - r.break_s) / r.tooth_s;
        o.found = t < r.break_s + limit_s;
      }
    }
  }
  return o;
}

// ---------------------------------------------------------------------------------------------
// Straight teeth by closed form (Tarng 1988, eq. 3-2 to 3-8, 3-40): the oracle of the averages.

struct Straight {
  unsigned teeth = 8;
  double amplitude_N = 1500 * 1.27 * 0.254;  // k_s a s of his table 4.1
  double ratio = 0.5263;                     // F_R / F_T
  double radius_m = 50.8e-3;
  std::vector<Engagement> arcs{{0, degrees(90)}};
  std::vector<double> throws;  // of the feed per tooth
  double break_s = 1e9;        // when tooth 0 loses `lost` of its edge
  double lost = 1;
  double second_s = 1e9;  // the same for tooth 4, and for tooth 2
  double third_s = 1e9;
  double feed = 1;  // of the usual feed per tooth

  struct Force {
    double x = 0, y = 0, torque = 0;
  };
  [[nodiscard]] double chip(unsigned tooth, double sine) const {
    if (throws.empty()) return feed * sine;
    double h = 1e9;
    for (unsigned k = 1; k <= teeth; ++k)
      h = std::min(h, throws[tooth] - throws[(tooth + teeth - k) % teeth] + k * feed * sine);
    return std::max(h, 0.0);
  }
  // `turn_rad`: angle of tooth 0, the next one lags by a pitch; `pitch_s`: time of a tooth period.
  [[nodiscard]] Force at(double t_s, double turn_rad, double pitch_s) const {
    Force f;
    for (unsigned i = 0; i < teeth; ++i) {
      const double angle = std::remainder(turn_rad - i * kTwoPi / teeth - kPi, kTwoPi) + kPi;
      bool engaged = false;
      for (const Engagement& arc : arcs)
        engaged = engaged || (angle >= arc.start_rad && angle <= arc.exit_rad);
      if (!engaged) continue;
      double part = 1;
      const auto breaks = [&](unsigned tooth, double when) {
        if (i == tooth && t_s >= when) part -= lost;
        if (i == (tooth + 1) % teeth && t_s - pitch_s >= when) part += lost;
      };
      breaks(0, break_s);
      breaks(4 % teeth, second_s);
      breaks(2, third_s);
      const double h = part * amplitude_N * chip(i, std::sin(angle));
      f.x += h * (std::cos(angle) + ratio * std::sin(angle));
      f.y += h * (ratio * std::cos(angle) - std::sin(angle));
      f.torque += h * radius_m;
    }
    return f;
  }
};

// Turns a spindle at a speed and feeds a monitor.
template <typename Real>
class Bench {
 public:
  Bench(const ToothBreakageConfig& c, double rpm, double start_rad = 0)
      : config_(c), rpm_(rpm), turn_(start_rad), monitor_(std::make_unique<Monitor<Real>>()) {
    CHECK_TEXT(Monitor<Real>::validate(c).reason(), "");
    monitor_->configure(c);
  }
  using Look = std::function<void(double t_s)>;
  using Change = std::function<void(double t_s, double& x, double& y, Quality& quality)>;
  // Until `until_s`; `look` after each sample that has moved the detector on.
  void run(const Straight& cut, double until_s, const Look& look = {}, const Change& change = {}) {
    for (; t_ < until_s; t_ += config_.sample_period_s) step(cut, look, change);
  }
  void step(const Straight& cut, const Look& look = {}, const Change& change = {}) {
    const double pitch_s = 60 / (rpm_ * config_.teeth);
    const auto f = cut.at(t_, turn_, pitch_s);
    double x = config_.torque ? f.torque : f.x;
    double y = config_.torque ? 0 : f.y;
    Quality quality = Quality::good;
    if (change) change(t_, x, y, quality);
    const double increment = rpm_ * kTwoPi / 60 * config_.sample_period_s;
    const double within = turn_ - kTwoPi * std::floor(turn_ / kTwoPi);
    const auto parts = monitor_->core().state().next;
    if (config_.torque) {
      monitor_->process(static_cast<Real>(x), static_cast<Real>(within),
                        static_cast<Real>(increment), quality);
    } else {
      monitor_->process(static_cast<Real>(x), static_cast<Real>(y), static_cast<Real>(within),
                        static_cast<Real>(increment), quality);
    }
    turn_ += increment;
    if (look && monitor_->core().state().next != parts) look(t_);
  }
  void set_rpm(double rpm) { rpm_ = rpm; }
  void slip(double angle_rad) { turn_ += angle_rad; }
  [[nodiscard]] double time() const { return t_; }
  [[nodiscard]] double turn() const { return turn_; }
  Monitor<Real>& monitor() { return *monitor_; }
  [[nodiscard]] double pitch_s() const { return 60 / (rpm_ * config_.teeth); }

 private:
  ToothBreakageConfig config_;
  double rpm_;
  double turn_;
  double t_ = 0;
  std::unique_ptr<Monitor<Real>> monitor_;
};

ToothBreakageConfig ideal(unsigned teeth, bool torque = false) {
  ToothBreakageConfig c;
  c.teeth = teeth;
  c.torque = torque;
  c.noise = torque ? 1e-4 : 1e-3;
  return c;
}

// Levels and differences of a broken tooth (values derived from Tarng 1988, ch. 4; continuous
// averages of tooth periods that begin with a tooth at its zero angle).
void test_sequences() {
  struct Row {
    double swept_deg;
    double intact;
    std::vector<double> broken;
    double rise, fall;
  };
  const std::vector<Row> rows = {
      {41.4096, 171.5, {0, 343.1, 171.5}, 343.1, -171.5},
      {60, 337.4, {143.8, 400.8, 478.5, 337.4}, 257.0, -193.7},
      {90, 648.2, {480.1, 400.8, 1123.0, 648.2}, 722.2, -474.8},
      {120, 917.7, {785.3, 592.3, 1123.0, 1225.2, 917.7}, 530.7, -307.5},
      {180, 1093.6, {1009.4, 745.5, 1147.7, 1441.7, 1205.6, 1093.6}, 402.2, -263.9},
  };
  for (const Row& row : rows) {
    Straight cut;
    cut.arcs = {{0, degrees(row.swept_deg)}};
    ToothBreakageConfig c = ideal(8);
    // 1000 samples a tooth period: a jump of the force is caught to half a sample, 0.1 %.
    c.sample_period_s = 12.5e-6;
    Bench<double> bench(c, 600);
    std::vector<double> levels;
    // A tooth period is complete when tooth 0 is at a multiple of the pitch.
    const auto look = [&](double) {
      const double pitches = bench.turn() * 8 / kTwoPi;
      if (std::abs(pitches - std::round(pitches)) < 0.1)
        levels.push_back(bench.monitor().core().state().level);
    };
    bench.run(cut, 0.3, look);
    CHECK_NEAR(levels.back(), row.intact, 0.003 * row.intact);
    // Breaks before it is due; its first period is the one that ends after t = 0.3 + one pitch.
    cut.break_s = bench.time() - 1e-3;
    levels.clear();
    bench.run(cut, 0.3 + 0.2, look);
    std::size_t first = 0;
    while (first < levels.size() && levels[first] > 0.995 * row.intact) ++first;
    for (std::size_t i = 0; i < row.broken.size(); ++i)
      CHECK_NEAR(levels[first + i], row.broken[i], 0.004 * row.intact);
    double rise = 0, fall = 0;
    for (std::size_t i = 8; i < 16; ++i) {
      rise = std::max(rise, levels[i] - levels[i - 1]);
      fall = std::min(fall, levels[i] - levels[i - 1]);
    }
    CHECK_NEAR(rise, row.rise, 0.006 * row.intact);
    CHECK_NEAR(fall, row.fall, 0.006 * row.intact);
  }
}

// Threshold over the swept angle, never told: a tenth of the feed per tooth of throw stays below
// it, a missing tooth goes above, with throw and without; the alarm comes within m + 3 periods.
void test_immersion() {
  using Immersion = servosense::ToothImmersion<double, 16, 4>;
  double worst_angle = 0, closest_throw = 0, closest_break = 1e9, longest = 0;
  int cases = 0, alarms = 0, found = 0;
  for (const bool torque : {false, true}) {
    for (const unsigned teeth : {2U, 3U, 4U, 5U, 8U, 10U}) {
      // The table falls and rises as it must.
      double shape = 0;
      for (int a = 6; a <= 180; a += 6) {
        const auto row = Immersion::row({teeth, 0.1, torque}, degrees(a));
        CHECK(row.shape > shape);
        CHECK(row.thrown <= row.threshold() && row.threshold() <= row.broken);
        shape = row.shape;
      }
      // Told or found from the shape, the angle gives the same threshold.
      Immersion table;
      table.configure({teeth, 0.1, torque});
      for (const double angle : {7., 33., 50., 91., 128., 171.}) {
        const auto row = Immersion::row({teeth, 0.1, torque}, degrees(angle));
        const auto told = table.from_angle(degrees(angle));
        const auto found_from = table.from_shape(row.shape);
        CHECK_NEAR(told.swept_rad, degrees(angle), 1e-12);
        CHECK_NEAR(found_from.swept_rad, degrees(angle), degrees(2));
        CHECK_BETWEEN(found_from.threshold / told.threshold, 0.9, 1.1);
        // Between rows of the table the threshold is what it is meant to be.
        CHECK_BETWEEN(told.threshold / row.threshold(), 0.85, 1.15);
      }
      for (const double swept : {10., 12., 15., 20., 30., 45., 60., 75., 90., 120., 150., 180.}) {
        for (const bool up : {true, false}) {
          Straight cut;
          cut.teeth = teeth;
          cut.arcs = {up ? Engagement{0, degrees(swept)} : Engagement{kPi - degrees(swept), kPi}};
          cut.throws.assign(teeth, 0);
          cut.throws[0] = 0.1;
          ToothBreakageConfig c = ideal(teeth, torque);
          c.sample_period_s = 60.0 / (600 * 4 * 90 * teeth);  // 360 samples a tooth period
          const double pitch_s = 60 / (600.0 * teeth);
          for (const double phase : {0.0, 0.37}) {
            ++cases;
            Bench<float> bench(c, 600, phase * kTwoPi / teeth);
            double ratio = 0, threshold = 1e9;
            const auto look = [&](double) {
              const auto& s = bench.monitor().core().state();
              if (s.signal != SignalState::good) return;
              ratio = std::max(ratio, static_cast<double>(s.ratio));
              threshold = std::min(threshold, static_cast<double>(s.threshold));
            };
            bench.run(cut, 0.6, look);
            // Thrown out; then without any throw, when the estimate must be the angle itself.
            closest_throw = std::max(closest_throw, ratio / threshold);
            alarms += bench.monitor().state().alarms > 0;
            Straight plain = cut;
            plain.throws.clear();
            Bench<float> other(c, 600, phase * kTwoPi / teeth);
            other.run(plain, 0.6);
            const double estimate =
                static_cast<double>(other.monitor().core().state().swept_rad) * 180 / kPi;
            worst_angle = std::max(worst_angle, std::abs(estimate - swept) / swept);
            plain.break_s = other.time() + phase * pitch_s;
            double size = 0;
            double delay = 1e9;
            other.run(plain, 0.6 + (teeth + 3) * pitch_s + phase * pitch_s, [&](double t) {
              const auto& s = other.monitor().core().state();
              size = std::max(size, static_cast<double>(s.ratio / s.threshold));
              if (other.monitor().state().alarms > 0)
                delay = std::min(delay, (t - plain.break_s) / pitch_s);
            });
            closest_break = std::min(closest_break, size);
            found += other.monitor().state().alarms == 1;
            if (delay < 1e9) longest = std::max(longest, delay - teeth);
          }
        }
      }
    }
  }
  check::figure("throw of a tenth: largest ratio / threshold, 10..180 deg", closest_throw);
  check::figure("missing tooth: least ratio / threshold", closest_break);
  check::figure("estimate of the swept angle, largest relative error", worst_angle);
  check::figure("longest delay beyond m", longest, "tooth periods");
  check::figure("cuts", cases);
  CHECK(closest_throw < 1);
  CHECK(closest_break > 1);
  CHECK(worst_angle < 0.1);
  CHECK(longest <= 3);
  CHECK(alarms == 0);
  CHECK(found == cases);
}

// The ratio knows neither material, depth nor feed, and grows with what is lost of the edge.
void test_scaling() {
  const auto largest = [](double amplitude, double lost) {
    Straight cut;
    cut.amplitude_N *= amplitude;
    cut.lost = lost;
    ToothBreakageConfig c = ideal(8);
    c.sample_period_s = 12.5e-6 * 4;
    Bench<float> bench(c, 600);
    cut.break_s = 0.3;
    double ratio = 0;
    bench.run(cut, 0.45, [&](double) {
      ratio = std::max(ratio, static_cast<double>(bench.monitor().core().state().ratio));
    });
    return ratio;
  };
  const double whole = largest(1, 1);
  CHECK(largest(4, 1) == whole);  // a power of two changes no digit
  CHECK_NEAR(largest(3.7, 1), whole, 1e-5);
  // Rise of the chipped tooth over that of the lost one: 0.62 (447.3 / 722.2 N) at 60 %.
  CHECK_BETWEEN(largest(1, 0.6) / whole, 0.55, 0.65);
  CHECK_BETWEEN(largest(1, 0.2) / whole, 0.15, 0.25);
}

// No alarm where the geometry or the feed changes, alarm when a tooth is lost on top of it.
void test_transients() {
  const Engagement slot{0, kPi}, half{0, degrees(90)};
  struct Case {
    const char* name;
    std::function<void(Straight&, double)> shape;  // the cut at a time
  };
  const std::vector<Case> cases = {
      {"square corner, full to half to full",
       [=](Straight& s, double t) { s.arcs = {t > 0.7 && t < 1.0 ? half : slot}; }},
      {"step into the corner and out within 15 tooth periods",
       [=](Straight& s, double t) { s.arcs = {t > 0.7 && t < 0.9 ? half : slot}; }},
      {"curved edge, full to half in three revolutions",
       [](Straight& s, double t) {
         s.arcs = {{0, degrees(180 - 90 * std::clamp((t - 0.7) / 0.3, 0.0, 1.0))}};
       }},
      {"slot across the way",
       [=](Straight& s, double t) {
         s.arcs.clear();
         if (t < 0.7 || t > 1.0) s.arcs = {half};
       }},
      {"hole in the middle of the width",
       [=](Straight& s, double t) {
         s.arcs = {slot};
         if (t > 0.7 && t < 1.0) s.arcs = {{0, degrees(70)}, {degrees(110), kPi}};
       }},
      {"depth doubles at once", [](Straight& s, double t) { s.amplitude_N = t > 0.7 ? 968 : 484; }},
      {"depth halves at once", [](Straight& s, double t) { s.amplitude_N = t > 0.7 ? 242 : 484; }},
      {"feed 0.38 to 0.19", [](Straight& s, double t) { s.feed = t > 0.7 ? 0.75 : 1.5; }},
      {"feed hold", [](Straight& s, double t) { s.feed = t > 0.7 && t < 1.3 ? 0.0 : 1.0; }},
      {"end of the cut at once",
       [](Straight& s, double t) {
         if (t > 0.7) s.arcs = {};
       }},
      {"beginning of the cut at once",
       [=](Straight& s, double t) {
         s.arcs.clear();
         if (t > 0.5) s.arcs = {half};
       }},
  };
  for (const Case& c : cases) {
    for (const bool torque : {false, true}) {
      for (const bool breaks : {false, true}) {
        Straight cut;
        cut.throws = {0.02, 0.08, 0.05, 0.0, 0.1, 0.03, 0.06, 0.01};
        ToothBreakageConfig config = ideal(8, torque);
        config.noise = torque ? 0.5 : 10;
        Bench<float> bench(config, 600);
        if (breaks) cut.break_s = 2.0;
        while (bench.time() < 3) {
          c.shape(cut, bench.time());
          bench.run(cut, bench.time() + kPeriod);
        }
        const bool alarm = bench.monitor().state().alarms > 0;
        const bool cutting = !cut.arcs.empty();
        if (alarm != (breaks && cutting))
          check::fail(__FILE__, __LINE__) << c.name << (torque ? " torque" : " force")
                                          << (alarm ? ": alarm\n" : ": no alarm\n");
        ++check::checks;
      }
    }
  }
}

// Three teeth lost one after the other (Tarng 1988, table 5.4: 1.02, 2.48, 3.98 s).
void test_three_breaks() {
  Straight cut;
  cut.break_s = 1.02;
  cut.second_s = 2.48;
  cut.third_s = 3.98;
  ToothBreakageConfig c = ideal(8);
  c.noise = 5;
  Bench<float> bench(c, 600);
  std::vector<double> found;
  bench.run(cut, 5, [&](double t) {
    if (bench.monitor().state().alarms > found.size()) found.push_back(t);
  });
  CHECK(found.size() == 3);
  if (found.size() != 3) return;
  CHECK_BETWEEN(found[0], 1.02, 1.02 + 11 * bench.pitch_s());
  CHECK_BETWEEN(found[1], 2.48, 2.48 + 11 * bench.pitch_s());
  CHECK_BETWEEN(found[2], 3.98, 3.98 + 11 * bench.pitch_s());
  // Lost teeth stay lost: told as a warning after the alarm is over.
  CHECK(bench.monitor().state().state == MonitorState::warning);
  CHECK(bench.monitor().core().lasts());
}

// Noise of the idle spindle, as learned, is never a broken tooth.
void test_noise() {
  for (const bool torque : {false, true}) {
    ToothBreakageConfig c = ideal(8, torque);
    const double sample = 3;
    c.sample_noise = (torque ? 1 : std::sqrt(2.0)) * sample;
    c.noise = sample / std::sqrt(60 / (4000.0 * 8 * kPeriod));
    Straight air;
    air.arcs.clear();
    Bench<float> bench(c, 4000);
    GaussianNoise noise(77);
    double value = 0, size = 0;
    bench.run(
        air, 100,
        [&](double) {
          const auto& s = bench.monitor().core().state();
          value = std::max(value, static_cast<double>(s.value));
          size = std::max(size, static_cast<double>(s.ratio) * static_cast<double>(s.mean));
        },
        [&](double, double& x, double& y, Quality&) {
          x = sample * noise.next();
          if (!torque) y = sample * noise.next();
        });
    CHECK(bench.monitor().state().alarms == 0);
    // In air nothing counts; and of 53 000 tooth periods none has a pattern of the 8 sigma that do.
    CHECK(value == 0);
    CHECK_BETWEEN(size / (8 * c.noise), 0.2, 1.0);
  }
}

// Vibration at no harmonic of the rotation moves load from tooth to tooth, grows in power to twice
// in a revolution and stays: no tooth is lost, whatever its frequency. While it lasts at a tenth of
// the torque, a tooth that is lost is still found.
void test_vibration() {
  constexpr double kStarts_s = 0.4, kBreaks_s = 0.85, kEnds_s = 1.1;
  for (int k = 0; k < 24; ++k) {
    for (const bool breaks : {false, true}) {
      Straight cut;
      cut.teeth = 4;
      if (breaks) cut.break_s = kBreaks_s;
      Bench<float> bench(ideal(cut.teeth, true), 3000);
      const double mean_Nm = 2 * cut.amplitude_N * cut.radius_m / kPi;
      const double most = (breaks ? 0.1 : 0.8) * mean_Nm;
      const double hz = 50 * (4.15 + 0.29 * k);
      std::uint64_t before = 0;
      bench.run(
          cut, kEnds_s,
          [&](double t_s) {
            if (t_s < kBreaks_s) before = bench.monitor().state().alarms;
          },
          [&](double t_s, double& x, double&, Quality&) {
            if (t_s < kStarts_s) return;
            const double grown = 1e-3 * most * std::exp2(0.5 * (t_s - kStarts_s) * 50);
            x += std::min(most, grown) * std::sin(kTwoPi * hz * t_s);
          });
      CHECK(before == 0);
      CHECK((bench.monitor().state().alarms > 0) == breaks);
    }
  }
}

// Run-out of the spindle hides the break in displacement; subtracted it does not, provided the
// angle is that of the teaching.
void test_runout() {
  const double per_N = 1 / 1.421e7;  // 1 kg at 600 Hz
  const auto alarms = [&](bool learn, double slip_rad) {
    Straight cut;
    cut.amplitude_N *= per_N;
    cut.break_s = 1.5;
    ToothBreakageConfig c = ideal(8);
    c.noise = 2e-7;
    Bench<double> bench(c, 600);
    double offset = 0;
    const Bench<double>::Change runout = [&](double, double& x, double& y, Quality&) {
      const double a = bench.turn() - offset;
      x += 80e-6 * std::cos(a) + 24e-6 * std::cos(3 * a + 1);
      y += 80e-6 * std::sin(a) - 18e-6 * std::sin(2 * a);
    };
    if (learn) bench.monitor().learn_runout(3);
    Straight air;
    air.arcs.clear();
    air.amplitude_N = cut.amplitude_N;
    bench.run(air, 0.5, {}, runout);
    CHECK(bench.monitor().state().runout == learn);
    bench.slip(slip_rad);
    offset = slip_rad;  // the spindle is where it was, the index is not
    double value = 0;
    bench.run(cut, 1.5, {}, runout);
    const auto before = bench.monitor().state().alarms;
    if (slip_rad == 0) CHECK(before == 0);
    bench.run(
        cut, 1.5 + 11 * bench.pitch_s(),
        [&](double) { value = std::max(value, bench.monitor().core().state().value); }, runout);
    return value;
  };
  const double plain = alarms(false, 0);
  const double subtracted = alarms(true, 0);
  const double wrong = alarms(true, degrees(180));
  check::figure("displacement with run-out: value of a break, as it is", plain);
  check::figure("  run-out subtracted", subtracted);
  check::figure("  subtracted with a wrong index", wrong);
  CHECK(subtracted > 2);
  CHECK(plain < 1);
  CHECK(wrong < 1);
}

// Displacement of a spindle of 1 kg at 600 Hz (Tarng 1988, sec. 5.3; values derived from it): its
// average is force over stiffness at every speed up to f_t = f_n, where the raw signal rings. There
// the shape is the structure's own, so the swept angle is told. A sensor far too slow is no use.
void test_displacement() {
  const double omega = kTwoPi * 600, stiffness = omega * omega, damping = 0.04;
  struct Row {
    double rpm, mean_um, rise_um;
  };
  for (const Row& row : {Row{225, 46.75, 49.56}, Row{900, 45.65, 50.84}, Row{2250, 45.62, 51.99},
                         Row{4500, 45.62, 54.08}}) {
    for (const bool slow_sensor : {false, true}) {
      Straight cut;
      const double pitch_s = 60 / (8 * row.rpm);
      ToothBreakageConfig c = ideal(8);
      c.sample_period_s = pitch_s / 64;
      c.swept_angle_rad = degrees(90);
      c.noise = 1e-7;
      c.minimum_speed_rad_s = 1;
      Bench<double> bench(c, row.rpm);
      double px = 0, py = 0, vx = 0, vy = 0, sx = 0, sy = 0;
      // Exact enough: 40 semi-implicit steps and more a period of the mode; force held between.
      const Bench<double>::Change structure = [&](double, double& x, double& y, Quality&) {
        const int steps = static_cast<int>(c.sample_period_s / 2e-5) + 1;
        const double h = c.sample_period_s / steps;
        for (int i = 0; i < steps; ++i) {
          vx += h * (x - 2 * damping * omega * vx - stiffness * px);
          vy += h * (y - 2 * damping * omega * vy - stiffness * py);
          px += h * vx;
          py += h * vy;
        }
        // First order at an eighth of the tooth frequency.
        const double part = 1 - std::exp(-c.sample_period_s * kTwoPi / (8 * pitch_s));
        sx += part * (px - sx);
        sy += part * (py - sy);
        x = slow_sensor ? sx : px;
        y = slow_sensor ? sy : py;
      };
      bench.run(cut, 60 * pitch_s, {}, structure);
      const auto& s = bench.monitor().core().state();
      CHECK(bench.monitor().state().alarms == 0);
      cut.break_s = bench.time();
      double rise = 0, fall = 0, value = 0;
      if (!slow_sensor) CHECK_NEAR(s.mean * 1e6, row.mean_um, 0.03 * row.mean_um);
      bench.run(
          cut, cut.break_s + 11 * pitch_s,
          [&](double) {
            rise = std::max(rise, s.difference * 1e6);
            fall = std::min(fall, s.difference * 1e6);
            value = std::max(value, s.value);
          },
          structure);
      if (slow_sensor) {
        CHECK(rise < 0.6 * row.rise_um);
        continue;
      }
      // The source's figures are from left edges of nine samples a tooth: 4 % more than the mean.
      CHECK_NEAR(rise, row.rise_um, 0.06 * row.rise_um);
      // Force over stiffness, -474.8 N: the ringing adds less than a tenth at any speed.
      CHECK_NEAR(fall, -474.8e6 / stiffness, 0.1 * 474.8e6 / stiffness);
      CHECK(bench.monitor().state().alarms == 1);
    }
  }
}

// A taught cycle is silent when it comes again, alarms when a tooth is lost in it, and the limits
// follow the factor.
void test_teaching() {
  using Mode = Monitor<float>::Teaching;
  const auto cycle = [](Bench<float>& bench, double break_after) {
    const double begin = bench.time();
    Straight cut;
    cut.throws = {0.1, 0, 0.05, 0.02, 0.08, 0, 0.03, 0.1};
    cut.break_s = begin + break_after;
    while (bench.time() < begin + 4) {
      const double t = bench.time() - begin;
      cut.arcs.clear();
      if (t > 0.5 && t < 3.5)
        cut.arcs = {t > 1.5 && t < 2.5 ? Engagement{0, kPi} : Engagement{0, degrees(60)}};
      bench.run(cut, bench.time() + kPeriod);
    }
  };
  for (const double factor : {1.5, 40.0}) {
    ToothBreakageConfig c = ideal(8);
    c.noise = 5;
    c.teaching_revolutions = 2;
    c.teaching_factor = factor;
    Bench<float> bench(c, 600);
    bench.monitor().start_cycle(Mode::teaching);
    cycle(bench, 1e9);
    CHECK(bench.monitor().state().alarms == 0);
    CHECK(bench.monitor().limits().state().intervals >= 19);
    bench.monitor().start_cycle(Mode::matching);
    cycle(bench, 1e9);
    CHECK(bench.monitor().state().alarms == 0);
    bench.monitor().start_cycle(Mode::matching);
    cycle(bench, 2.0);
    CHECK((bench.monitor().state().alarms > 0) == (factor < 2));
  }
}

// Bad samples neither latch nor alarm, a tooth lost afterwards is found.
template <typename Real>
void test_faults() {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  struct Fault {
    const char* name;
    std::function<void(double, double&, double&, Quality&)> change;
  };
  const std::vector<Fault> faults = {
      {"NaN", [&](double, double& x, double&, Quality&) { x = nan; }},
      {"infinite", [&](double, double&, double& y, Quality&) { y = infinity; }},
      {"huge", [](double, double& x, double& y, Quality&) { x = y = 1e30; }},
      {"invalid",
       [](double, double& x, double&, Quality& q) {
         x = 7e5;
         q = Quality::invalid;
       }},
      {"missing", [](double, double&, double&, Quality& q) { q = Quality::missing; }},
      {"stuck", [](double, double&, double&, Quality& q) { q = Quality::stuck; }},
      {"gap", [](double, double&, double&, Quality& q) { q = Quality::gap; }},
      {"restarted", [](double, double&, double&, Quality& q) { q = Quality::restarted; }},
      {"settling",
       [](double, double& x, double&, Quality& q) {
         x = 0;
         q = Quality::settling;
       }},
      {"dead bus",
       [&](double, double& x, double&, Quality& q) {
         x = nan;
         q = Quality::dead_bus;
       }},
  };
  for (const Fault& fault : faults) {
    for (const double lasts : {kPeriod, 20 * kPeriod, 0.3}) {
      Straight cut;
      cut.break_s = 2;
      ToothBreakageConfig c = ideal(8);
      c.noise = 5;
      Bench<Real> bench(c, 600);
      bool alarm = false, other = false;
      const auto change = [&](double t, double& x, double& y, Quality& q) {
        if (t >= 0.8 && t < 0.8 + lasts) fault.change(t, x, y, q);
      };
      bench.run(cut, 0.8, {}, change);
      CHECK(bench.monitor().state().state == MonitorState::armed);
      while (bench.time() < 0.8 + lasts) {
        bench.run(cut, bench.time() + kPeriod / 2, {}, change);
        other = other || bench.monitor().state().state != MonitorState::armed;
      }
      CHECK(other);  // it says so
      bench.run(cut, 2, {}, change);
      alarm = bench.monitor().state().alarms > 0;
      if (alarm) check::fail(__FILE__, __LINE__) << fault.name << " alarms\n";
      ++check::checks;
      CHECK(bench.monitor().state().state == MonitorState::armed);
      bench.run(cut, 2 + 11 * bench.pitch_s(), {}, change);
      CHECK(bench.monitor().state().alarms == 1);
      const auto& s = bench.monitor().core().state();
      CHECK(servosense::is_finite(s.level) && servosense::is_finite(s.value));
    }
  }
  // At rest, and trembling there, it idles; without noise learned it idles as well.
  Bench<Real> rest(ideal(8), 600);
  rest.run(Straight{}, 0.5);
  rest.set_rpm(1e-9);
  rest.run(Straight{}, 2);
  CHECK(rest.monitor().state().state == MonitorState::idle);
  ToothBreakageConfig off = ideal(8);
  off.noise = 0;
  Bench<Real> idle(off, 600);
  idle.run(Straight{}, 0.5);
  CHECK(idle.monitor().state().state == MonitorState::idle);
}

// What an alarm was raised from raises it again, bit for bit.
template <typename Real>
void test_replay() {
  static_assert(std::is_trivially_copyable_v<typename Monitor<Real>::Core>);
  Straight cut;
  cut.throws = {0.1, 0, 0.05, 0.02, 0.08, 0, 0.03, 0.1};
  cut.break_s = 1.234;
  ToothBreakageConfig c = ideal(8);
  c.noise = 5;
  Bench<Real> bench(c, 733);
  bench.run(cut, 1.6);
  CHECK(bench.monitor().state().alarms == 1);
  const auto evidence = bench.monitor().evidence();
  CHECK(evidence.count > 0);
  auto core = std::make_unique<typename Monitor<Real>::Core>();
  CHECK(Monitor<Real>::replay(evidence, *core) == MonitorState::alarm);
  const auto then = core->state();
  // Once more, beside the live one: stop the live one at the alarm.
  Bench<Real> again(c, 733);
  while (again.monitor().state().alarms == 0 && again.time() < 1.6)
    again.run(cut, again.time() + kPeriod / 2);
  const auto& live = again.monitor().core().state();
  CHECK(std::memcmp(&live.value, &then.value, sizeof(Real)) == 0);
  CHECK(std::memcmp(&live.level, &then.level, sizeof(Real)) == 0);
  CHECK(std::memcmp(&live.tolerated, &then.tolerated, sizeof(Real)) == 0);
  CHECK(live.levels == then.levels);
  // Without the last input there is no alarm yet.
  auto less = evidence;
  --less.count;
  CHECK(Monitor<Real>::replay(less, *core) != MonitorState::alarm);
}

void test_validate() {
  const auto refuses = [](auto&& change, const char* parameter) {
    ToothBreakageConfig c = ideal(8);
    change(c);
    const auto status = Monitor<float>::validate(c);
    CHECK(!status.ok());
    CHECK_TEXT(status.parameter(), parameter);
  };
  refuses([](auto& c) { c.sample_period_s = 0; }, "sample_period_s");
  refuses([](auto& c) { c.teeth = 1; }, "teeth");
  refuses([](auto& c) { c.teeth = 17; }, "teeth");
  refuses([](auto& c) { c.noise = -1; }, "noise");
  refuses([](auto& c) { c.sample_noise = std::nan(""); }, "sample_noise");
  refuses([](auto& c) { c.minimum_speed_rad_s = 0; }, "minimum_speed_rad_s");
  refuses([](auto& c) { c.tolerated_throw = 0; }, "tolerated_throw");
  refuses([](auto& c) { c.swept_angle_rad = 4; }, "swept_angle_rad");
  refuses([](auto& c) { c.new_fraction = 0; }, "new_fraction");
  refuses([](auto& c) { c.noise_factor = 0; }, "noise_factor");
  refuses([](auto& c) { c.memory_s = 0; }, "memory_s");
  refuses([](auto& c) { c.release_revolutions = 0; }, "release_revolutions");
  refuses([](auto& c) { c.consecutive_revolutions = 0; }, "consecutive_revolutions");
  refuses([](auto& c) { c.teaching_revolutions = 0; }, "teaching_revolutions");
  refuses([](auto& c) { c.teaching_factor = 0.5; }, "teaching_factor");
  refuses([](auto& c) { c.threshold = -1; }, "threshold");
}

// ---------------------------------------------------------------------------------------------

// Part of pairs in which the broken one scores higher, ties half (area under the curve).
double area(std::vector<double> intact, const std::vector<double>& broken) {
  std::sort(intact.begin(), intact.end());
  double sum = 0;
  for (const double b : broken) {
    const auto low = std::lower_bound(intact.begin(), intact.end(), b);
    const auto high = std::upper_bound(low, intact.end(), b);
    sum += static_cast<double>(low - intact.begin()) + 0.5 * static_cast<double>(high - low);
  }
  return sum / (static_cast<double>(intact.size()) * static_cast<double>(broken.size()));
}

// Part of the broken found by a fixed limit that one in a hundred intact ones passes.
double found_at_one_percent(std::vector<double> intact, const std::vector<double>& broken) {
  std::sort(intact.begin(), intact.end());
  const double limit = intact[intact.size() - 1 - intact.size() / 100];
  std::size_t n = 0;
  for (const double b : broken) n += b > limit;
  return static_cast<double>(n) / static_cast<double>(broken.size());
}

struct Tally {
  std::size_t intact = 0, false_alarms = 0, broken = 0, found = 0;
};

Tally survey(const char* name, Signal signal, bool flexible, Breaking breaking, int seeds,
             std::uint64_t first, bool print) {
  const auto events = kEvents.size();
  const std::size_t jobs = events * static_cast<std::size_t>(seeds);
  std::vector<std::array<Outcome, 2>> outcomes(jobs);
  std::vector<std::array<std::string, 2>> texts(jobs);
  servosense::run_parallel(jobs, [&](std::size_t j) {
    const auto event = static_cast<Event>(j % events);
    // The intact cut is another one than the broken one.
    const std::uint64_t seed = first + 2 * j;
    const auto intact = simulate(seed, {event, Breaking::none, flexible, 0.1});
    const auto broken = simulate(seed + 1, {event, breaking, flexible, 0.1});
    outcomes[j] = {watch(intact, signal), watch(broken, signal)};
    texts[j] = {intact.text, broken.text};
  });
  Tally t;
  std::vector<double> value[2], raw[2], difference[2], plain[2], delays;
  for (std::size_t j = 0; j < jobs; ++j) {
    for (int b = 0; b < 2; ++b) {
      const Outcome& o = outcomes[j][static_cast<std::size_t>(b)];
      if (!o.valid) continue;
      value[b].push_back(o.score);
      raw[b].push_back(o.raw);
      difference[b].push_back(o.difference);
      plain[b].push_back(o.difference * o.mean);
      ++t.intact;  // up to the break
      t.false_alarms += o.false_alarm;
      const std::string& text = texts[j][static_cast<std::size_t>(b)];
      if (o.false_alarm && print) std::printf("    false alarm: %s\n", text.c_str());
      if (b == 0) continue;
      ++t.broken;
      t.found += o.found;
      if (o.found) delays.push_back(o.delay_teeth);
      if (!o.found && print) std::printf("    not found (%.2f): %s\n", o.score, text.c_str());
    }
  }
  std::sort(delays.begin(), delays.end());
  std::printf(
      "  %-22s found %zu of %zu, false alarms %zu of %zu; delay median %.1f, longest %.1f teeth\n"
      "      AUC monitor %.4f, first difference over the mean %.4f, in N or Nm %.4f, raw %.4f\n"
      "      found at 1 %% false: %.3f, %.3f, %.3f, %.3f\n",
      name, t.found, t.broken, t.false_alarms, t.intact,
      delays.empty() ? 0 : delays[delays.size() / 2], delays.empty() ? 0 : delays.back(),
      area(value[0], value[1]), area(difference[0], difference[1]), area(plain[0], plain[1]),
      area(raw[0], raw[1]), found_at_one_percent(value[0], value[1]),
      found_at_one_percent(difference[0], difference[1]), found_at_one_percent(plain[0], plain[1]),
      found_at_one_percent(raw[0], raw[1]));
  CHECK(area(value[0], value[1]) >= area(difference[0], difference[1]));
  CHECK(area(value[0], value[1]) > area(raw[0], raw[1]));
  return t;
}

// Random cuts: one tooth broken off, found within m + 3 tooth periods. Limits on the naive values
// are given the mean force of each cut, which nobody would know.
void test_random_cuts(bool nightly) {
  const int seeds = nightly ? 150 : 4;
  const std::uint64_t first = nightly ? 100000 : 50000;
  std::printf("random cuts from seed %llu\n", static_cast<unsigned long long>(first));
  const auto judge = [&](const Tally& t, double found, double false_alarms) {
    CHECK(t.broken > 0 && static_cast<double>(t.found) >= found * static_cast<double>(t.broken));
    CHECK(static_cast<double>(t.false_alarms) <= false_alarms * static_cast<double>(t.intact));
  };
  judge(survey("force", Signal::force, false, Breaking::broken, seeds, first, true), 0.98, 0.01);
  judge(survey("torque", Signal::torque, false, Breaking::broken, seeds, first + 10000, true), 0.98,
        0.01);
  if (!nightly) return;
  judge(survey("force, low-passed", Signal::drive, false, Breaking::broken, seeds, first + 20000,
               true),
        0.98, 0.01);
  judge(survey("force, flexible", Signal::force, true, Breaking::broken, seeds / 3, first + 30000,
               true),
        0.95, 0.02);
  judge(survey("torque, flexible", Signal::torque, true, Breaking::broken, seeds / 3, first + 40000,
               true),
        0.95, 0.02);
  survey("force, 60 % of an edge", Signal::force, false, Breaking::chipped, seeds / 3,
         first + 50000, false);
  survey("torque, 60 % of an edge", Signal::torque, false, Breaking::chipped, seeds / 3,
         first + 60000, false);
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  test_validate();
  test_sequences();
  test_immersion();
  test_scaling();
  test_transients();
  test_three_breaks();
  test_noise();
  test_vibration();
  test_runout();
  test_displacement();
  test_teaching();
  test_faults<float>();
  test_faults<double>();
  test_replay<float>();
  test_replay<double>();
  test_random_cuts(nightly);
  return check::done();
}
