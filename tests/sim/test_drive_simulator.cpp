// The drive simulator against Runge-Kutta integrations of the same machine written out by hand,
// closed forms of linear systems, and the books: momentum, energy, counts.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/core/units.hpp"
#include "servosense/sim/drive_simulator.hpp"
#include "servosense/sim/trajectory.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod = 125e-6;
constexpr double kLead = 0.016;

// X axis of Koike 2016, table 3-4, with a force constant and gains of our own choice: velocity loop
// at about 40 Hz.
DriveSimulatorConfig axis() {
  DriveSimulatorConfig c;
  c.drive.inertia = 227;
  c.drive.viscous = 732;
  c.drive.coulomb = 0;
  c.drive.unit_per_turn = kLead;
  c.effort_per_A = 200;
  c.controller.position_gain_per_s = 30;
  c.controller.velocity_gain_A_s = 285;
  c.controller.velocity_integral_per_s = 40;
  c.controller.current_bandwidth_hz = 500;
  return c;
}

DriveSimulator made(const DriveSimulatorConfig& c) {
  auto simulator = DriveSimulator::create(c);
  if (!simulator) {
    std::cout << simulator.error().sentence << '\n';
    std::exit(1);
  }
  return *simulator;
}

EffectSetting setting(const char* name, std::initializer_list<double> scalars) {
  EffectSetting s;
  s.effect = drive_effect_index(name);
  std::size_t p = 0;
  for (const double x : scalars) {
    s.parameters[p].value[0] = x;
    s.parameters[p++].count = 1;
  }
  return s;
}

void add(DriveSimulatorConfig& c, const EffectSetting& s) {
  c.drive.effects.settings[c.drive.effects.count++] = s;
}

// ---- Linear drive, written out: states x1 v1 x2 v2 and the current; one mass when share is 0.
struct LinearDrive {
  DriveSimulatorConfig c;
  double share = 0, resonance = 0, damping = 0;
  std::array<double, 5> y{};
  std::vector<double> asked;  // current references so far
  double integral = 0, last = 0;

  [[nodiscard]] std::array<double, 5> slope(const std::array<double, 5>& s, double reference_A,
                                            double cutting) const {
    const double J = c.drive.inertia, D = c.drive.viscous;
    const double w = kTwoPi * resonance;
    const double reduced = J * share * (1 - share);
    const double spring =
        share > 0 ? reduced * w * w * (s[0] - s[2]) + reduced * 2 * damping * w * (s[1] - s[3])
                  : cutting;
    return {s[1], (c.effort_per_A * s[4] - D * s[1] - spring) / (J * (1 - share)), s[3],
            share > 0 ? (spring - cutting) / (J * share) : 0,
            kTwoPi * c.controller.current_bandwidth_hz * (reference_A - s[4])};
  }
  // One servo period in `steps` classical Runge-Kutta steps of fourth order.
  void period(double reference, double cutting, int steps) {
    const CascadeConfig& k = c.controller;
    const double T = c.sample_period_s;
    const double v = (y[0] - last) / T;
    last = y[0];
    const double e = c.loop == DriveLoop::position ? k.position_gain_per_s * (reference - y[0]) - v
                                                   : reference - v;
    integral += k.velocity_gain_A_s * k.velocity_integral_per_s * T * e;
    asked.push_back(k.velocity_gain_A_s * e + integral);
    const double h = T / steps;
    const auto n = static_cast<long>(asked.size()) - 1;
    for (int i = 0; i < steps; ++i) {
      const double t = (static_cast<double>(n) * T + (i + 0.5) * h) - k.delay_s;
      const auto then = static_cast<long>(std::floor(t / T));
      const double u = then < 0 ? 0 : asked[static_cast<std::size_t>(then)];
      const auto at = [&](const std::array<double, 5>& d, double by) {
        std::array<double, 5> s = y;
        for (std::size_t j = 0; j < 5; ++j) s[j] += by * d[j];
        return slope(s, u, cutting);
      };
      const auto k1 = slope(y, u, cutting), k2 = at(k1, h / 2), k3 = at(k2, h / 2), k4 = at(k3, h);
      for (std::size_t j = 0; j < 5; ++j) y[j] += h / 6 * (k1[j] + 2 * k2[j] + 2 * k3[j] + k4[j]);
    }
  }
};

// Largest difference of motor position over 0.3 s of a step and a cutting force that comes and
// goes.
double difference(const DriveSimulatorConfig& c, LinearDrive oracle) {
  DriveSimulator s = made(c);
  double worst = 0;
  for (int n = 0; n < 2400; ++n) {
    const double reference = n < 4 ? 0 : c.loop == DriveLoop::position ? 1e-3 : 0.05;
    const double cutting = n > 800 && n < 1600 ? 500 : 0;
    const DriveSimSample sample = s.step(reference, cutting);
    worst = std::max(worst, std::abs(sample.position - oracle.y[0]));
    oracle.period(reference, cutting, 64);
  }
  return worst;
}

// Second order: halving the step quarters the error; between 3.5 and 4.5 leaves room for the next
// term.
void linear_drive(const char* name, DriveSimulatorConfig c, double share, double resonance,
                  double damping) {
  LinearDrive oracle{c, share, resonance, damping, {}, {}, 0, 0};
  if (share > 0) add(c, setting("flexible-coupling", {resonance, damping, share}));
  std::array<double, 3> error{};
  for (std::size_t i = 0; i < 3; ++i) {
    c.substeps = 8U << i;
    error[i] = difference(c, oracle);
  }
  check::figure(std::string(name) + ": error at 8 steps a sample", error[0], "m");
  check::figure(std::string(name) + ": error ratio on halving", error[0] / error[1]);
  CHECK_BETWEEN(error[0] / error[1], 3.5, 4.5);
  CHECK_BETWEEN(error[1] / error[2], 3.5, 4.5);
  CHECK(error[2] < 1e-3 * 1e-3);  // a thousandth of the motion
}

void against_runge_kutta() {
  linear_drive("one mass", axis(), 0, 0, 0);
  DriveSimulatorConfig late = axis();
  late.controller.delay_s = 3.625 * kPeriod;  // arrives within a period, on a Runge-Kutta step
  linear_drive("one mass, delay", late, 0, 0, 0);
  linear_drive("two masses", axis(), 0.45, 110, 0.04);
  DriveSimulatorConfig spindle;
  spindle.loop = DriveLoop::velocity;
  spindle.drive.inertia = 0.0048;
  spindle.drive.viscous = 4.775e-4;
  spindle.effort_per_A = 0.5;
  spindle.controller = {0, 1.0, 30, 1e9, 600, 0.75 * kPeriod};
  linear_drive("spindle", spindle, 0, 0, 0);
}

// Fast sampling and a perfect current loop leave the continuous PI loop
//   v / r = (p s + q) / (J s^2 + (D + p) s + q),   p = gain K, q = p integral.
void against_closed_form() {
  DriveSimulatorConfig c = axis();
  c.loop = DriveLoop::velocity;
  c.sample_period_s = 2e-6;
  c.controller.current_bandwidth_hz = 0;
  c.controller.velocity_integral_per_s = 120;
  const double J = c.drive.inertia, D = c.drive.viscous;
  const double p = c.controller.velocity_gain_A_s * c.effort_per_A;
  const double q = p * c.controller.velocity_integral_per_s;
  const double a = (D + p) / (2 * J), w = std::sqrt(q / J - a * a);
  DriveSimulator s = made(c);
  double worst = 0;
  for (int n = 0; n < 50000; ++n) {
    const DriveSimSample sample = s.step(1);
    const double t = sample.t_s;
    // 1 - e^-at (cos wt + b sin wt) with v'(0) = p/J.
    const double b = (a - p / J) / w;
    const double v = 1 - std::exp(-a * t) * (std::cos(w * t) + b * std::sin(w * t));
    worst = std::max(worst, std::abs(sample.velocity - v));
  }
  check::figure("velocity step, largest error", worst, "m/s");
  // The loop sees the velocity half a period late and holds the current for another half: one
  // period of dead time, times the steepest slope p/J of a loop that overshoots little.
  CHECK_BETWEEN(worst, 0, 1.5 * c.sample_period_s * p / J);
}

// With friction: order two still, its kinks cost at most part of an order.
void convergence_with_friction() {
  DriveSimulatorConfig c = axis();
  c.drive.coulomb = 94;
  add(c, setting("stribeck-friction", {60, 0.004}));
  add(c, setting("presliding-hysteresis", {1e7, 60}));
  Trajectory t;
  (void)t.move_to(0.004, {0.1, 3, 200});
  (void)t.move_to(0.0035, {0.01, 1, 100});
  (void)t.dwell(0.1);
  const auto positions = [&](unsigned substeps) {
    c.substeps = substeps;
    DriveSimulator s = made(c);
    std::vector<double> x;
    for (const DriveSimSample& sample :
         s.run(t.duration_s(), [&](double time) { return t.at(time).position; }))
      x.push_back(sample.position);
    return x;
  };
  const std::vector<double> fine = positions(1024);
  const auto error = [&](unsigned substeps) {
    const std::vector<double> x = positions(substeps);
    double sum = 0;
    for (std::size_t i = 0; i < x.size(); ++i) sum += (x[i] - fine[i]) * (x[i] - fine[i]);
    return std::sqrt(sum / static_cast<double>(x.size()));
  };
  const double e8 = error(8), e16 = error(16), e32 = error(32);
  check::figure("friction: rms error at 8 steps a sample", e8, "m");
  check::figure("friction: order from 8 to 32", std::log2(e8 / e32) / 2);
  CHECK_BETWEEN(std::log2(e8 / e32) / 2, 1.6, 2.4);
  CHECK(e16 < e8 && e32 < e16);
}

// A force of half the Coulomb friction on a drive at rest: it hangs on the friction's spring
// k = C / knee and swings there, at sqrt(k/J), no faster and never through.
void stiction() {
  DriveSimulatorConfig c = axis();
  c.controller = {};
  c.drive.viscous = 0;
  c.drive.coulomb = 94;
  DriveSimulator s = made(c);
  const double k = c.drive.coulomb / c.drive.friction_knee;
  double low = 0;
  int crossings = 0;
  double last = 0;
  const int samples = 16000;
  for (int n = 0; n < samples; ++n) {
    const DriveSimSample sample = s.step(0, 47);
    low = std::min(low, sample.position);
    if (sample.velocity * last < 0) ++crossings;
    last = sample.velocity;
  }
  // Swings between 0 and twice the deflection under the force, which is where the friction ends.
  CHECK_NEAR(low, -2 * 47 / k, 0.01 * 2 * 47 / k);
  const double expected = samples * kPeriod * std::sqrt(k / c.drive.inertia) / kPi;
  CHECK_NEAR(crossings, expected, 1 + 0.001 * expected);  // (w h)^2/24 is 1e-5
  // Beyond the friction it slides, and stops when the force has gone.
  DriveSimulator slides = made(c);
  for (int n = 0; n < 800; ++n) (void)slides.step(0, 150);
  const double pushed = -slides.step(0, 0).position;
  for (int n = 0; n < 8000; ++n) (void)slides.step(0, 0);
  const DriveSimSample end = slides.step(0, 0);
  CHECK(end.position < -1e-4);
  // What the force put in, 150 N over the way that it pushed, friction has eaten; the knees aside.
  CHECK_NEAR(-end.position, 150 * pushed / 94, 3 * c.drive.friction_knee);
}

// J dv = (effort - resistance - cutting) dt over every period, to rounding; and the energy: what
// the cutting force puts in is kinetic energy and heat.
void books() {
  DriveSimulatorConfig c = axis();
  c.drive.coulomb = 94;
  DriveSimulator s = made(c);
  Trajectory t;
  (void)t.move_to(0.05, {0.3, 5, 200});
  const auto run = s.run(
      t.duration_s() + 0.1, [&](double time) { return t.at(time).position; },
      [](double time) { return time > 0.1 ? 80 * std::sin(300 * time) : 0; });
  double worst = 0, motor = 0, heat = 0, cut = 0, kinetic = 0;
  for (std::size_t n = 0; n + 1 < run.size(); ++n) {
    const DriveSimSample& a = run[n];
    const DriveSimSample& b = run[n + 1];
    worst = std::max(worst, std::abs(c.drive.inertia * (b.velocity - a.velocity) / kPeriod -
                                     (a.effort - a.resistance - a.cutting)));
    const double way = b.position - a.position;
    motor += a.effort * way;
    heat += a.resistance * way;
    cut += a.cutting * way;
    kinetic = c.drive.inertia * b.velocity * b.velocity / 2;
  }
  CHECK_NEAR(worst, 0, 1e-6);  // rounding of v at 1e-16 times J/T
  check::figure("work of the motor", motor, "J");
  // Mean force times way, where force and speed both change within a period: second order, 1e-4.
  CHECK_NEAR(motor, heat + cut + kinetic, 1e-4 * motor);
  CHECK(motor > 1);
}

// Free undamped pair: resonance by its formula, and after 20 s it swings as on the first day.
void two_masses() {
  DriveSimulatorConfig c = axis();
  c.controller = {};
  c.drive.viscous = 0;
  add(c, setting("flexible-coupling", {90, 0, 0.4}));
  DriveSimulator s = made(c);
  double first = 0, last = 0, before = 0, began = 0, ended = 0;
  int periods = -1;
  const double drift = -1.0 / 227;  // both masses, after a blow of 1 N s
  for (int n = 0; n < 160000; ++n) {
    const DriveSimSample sample = s.step(0, n == 0 ? 1 / kPeriod : 0);
    const double v = sample.velocity - drift;
    if (n > 0 && n < 8000) first = std::max(first, std::abs(v));
    if (n >= 152000) last = std::max(last, std::abs(v));
    if (n > 8 && before < 0 && v >= 0) {
      const double t = sample.t_s - kPeriod * v / (v - before);
      if (++periods == 0) began = t;
      ended = t;
    }
    before = v;
  }
  const double resonance = periods / (ended - began);
  check::figure("two masses: resonance, 90 Hz asked for", resonance, "Hz");
  CHECK_NEAR(resonance, 90, 90 * 1.5e-4);    // (w h)^2/24 with h = T/4: 1.3e-5; crossings: 1e-4
  CHECK_NEAR(last / first, 1, 1e-3);         // sampling of the peaks: (w T)^2/8 = 6e-4
  CHECK_NEAR(first, 1.0 / 227, 2e-3 / 227);  // the motor swings about the drift

  // At the antiresonance the load holds the motor still: the speed for a given force is the least.
  const double anti = 90 * std::sqrt(1 - 0.4);
  const auto response = [&](double hz) {
    DriveSimulatorConfig shaken = axis();
    shaken.controller = {};
    shaken.drive.viscous = 0;
    shaken.loop = DriveLoop::velocity;
    add(shaken, setting("flexible-coupling", {90, 0.01, 0.4}));
    shaken.vibrations.push_back({hz, 100, kPi / 2});  // a cosine: no momentum left over
    DriveSimulator sim = made(shaken);
    double re = 0, im = 0;
    int counted = 0;
    for (int n = 0; n < 40000; ++n) {
      const DriveSimSample sample = sim.step(0);
      if (n < 24000) continue;  // 3 s: the free swing has decayed to exp(-2 pi 90 * 0.01 * 3)
      ++counted;
      re += sample.velocity * std::cos(kTwoPi * hz * sample.t_s);
      im += sample.velocity * std::sin(kTwoPi * hz * sample.t_s);
    }
    return 2 * std::hypot(re, im) / counted / 100;
  };
  // |v/F| of the pair, from its transfer function.
  const auto formula = [&](double hz) {
    const double w = kTwoPi * hz, wr = kTwoPi * 90, wa = kTwoPi * anti;
    const double top_re = wa * wa - w * w, top_im = 2 * 0.01 * wr * 0.6 * w;
    const double low_re = wr * wr - w * w, low_im = 2 * 0.01 * wr * w;
    return std::hypot(top_re, top_im) / std::hypot(low_re, low_im) / (227 * 0.6 * w);
  };
  for (const double hz : {40.0, 69.0, 69.5, 70.0, 70.5, 80.0, 100.0, 150.0}) {
    check::figure("|v/F| at " + std::to_string(hz) + " Hz over its formula",
                  response(hz) / formula(hz));
    // 2 s hold whole periods. The antiresonance, 69.71 Hz, is off by (w h)^2/24 = 8e-6 of itself,
    // which at 0.3 Hz from it is 2e-3 of the response.
    CHECK_NEAR(response(hz) / formula(hz), 1, 3e-3);
  }
}

// Turning back and forth, the load lags by half the play and the flank's give, either way.
void play() {
  DriveSimulatorConfig c = axis();
  c.drive.coulomb = 94;
  const double b = 40e-6;
  add(c, setting("backlash", {b}));
  DriveSimulator s = made(c);
  Trajectory t;
  const MotionLimits slow{0.02, 1, 100};
  (void)t.move_to(0.02, slow);
  (void)t.move_to(0, slow);
  const auto run = s.run(t.duration_s(), [&](double time) { return t.at(time).position; });
  const auto lag = [&](double from, double to) {
    double sum = 0;
    int n = 0;
    for (const DriveSimSample& x : run)
      if (x.t_s >= from && x.t_s < to) sum += x.position - x.load_position, ++n;
    return sum / n;
  };
  const double forward = lag(0.6, 0.9), backward = lag(1.65, 1.95);
  // Half of the friction is the load's; flank stiffness m2 (2 pi 200 Hz)^2.
  const double give = (47 + 366 * 0.02) / (113.5 * std::pow(kTwoPi * 200, 2));
  check::figure("play seen between motor and load", (forward - backward) * 1e6, "um");
  CHECK_NEAR(forward - backward, b + 2 * give, 1e-8);  // a hundredth of the give, for the tracking
  CHECK_NEAR(forward + backward, 0, 1e-8);
  // On a flank, motor and load together have the friction of the whole drive: 94 N + 732 N s/m v,
  // and no acceleration to speak of.
  double carried = 0;
  int n = 0;
  for (const DriveSimSample& x : run)
    if (x.t_s >= 0.6 && x.t_s < 0.9) carried += x.effort, ++n;
  CHECK_NEAR(carried / n, 94 + 732 * 0.02, 0.01);
  // While the gap is crossed the motor carries only its own half.
  double least = 1e9;
  for (const DriveSimSample& x : run)
    if (x.t_s > t.duration_s() / 2) least = std::min(least, std::abs(x.resistance));
  CHECK(least < 47);
}

// A current limit: kept, and the integrator does not wind up behind it.
void current_limit() {
  DriveSimulatorConfig c = axis();
  c.loop = DriveLoop::velocity;
  c.controller.current_limit_A = 5;
  c.reported = ReportedCurrent::reference;
  DriveSimulator s = made(c);
  double most = 0, fastest = 0;
  for (int n = 0; n < 16000; ++n) {
    const DriveSimSample sample = s.step(0.5);
    most = std::max(most, std::abs(sample.current_A));
    fastest = std::max(fastest, sample.velocity);
  }
  CHECK(most == 5);
  // 0.1 s at the limit. A wound-up integrator would store gain * integral * 0.025 m/s s = 285 A and
  // shoot over by more than half; the linear loop's own overshoot is a few percent.
  check::figure("overshoot after saturation", fastest / 0.5 - 1);
  CHECK(fastest / 0.5 - 1 < 0.08);
  CHECK_NEAR(s.step(0.5).velocity, 0.5, 1e-4);
}

// Counter readings of any width, fed through the observer's input block, give the position back.
void encoder() {
  for (const unsigned bits : {6U, 8U, 16U, 17U, 20U, 31U, 32U, 33U, 63U, 64U}) {
    DriveSimulatorConfig c = axis();
    c.encoder.counts_per_turn = 8192;
    c.encoder.counter_bits = bits;
    c.encoder.initial_counts = (std::int64_t{1} << (bits < 62 ? bits - 1 : 61)) - 20;
    DriveSimulator s = made(c);
    DriveInputConfig in;
    in.unit_per_count = kLead / 8192;
    in.counter_bits = bits;
    in.unit_per_turn = kLead;
    DriveInput<double> input;
    input.configure(in);
    Trajectory t;
    // One count is 2 um; at most 31 counts per period, so 0.4 m/s is safe for six bits.
    (void)t.move_to(bits < 10 ? 0.02 : 0.2, {0.3, 10, 1000});
    (void)t.move_to(-0.03, {0.3, 10, 1000});
    double worst = 0;
    std::int64_t top = 0;
    for (const DriveSimSample& x :
         s.run(t.duration_s(), [&](double time) { return t.at(time).position; })) {
      RawDriveSample<double> raw;
      raw.counts = x.angle_counts;
      worst = std::max(worst, std::abs(input.process(raw).position - x.position));
      top = std::max(top, x.angle_counts);
      if (bits < 64) CHECK(x.angle_counts >= 0 && x.angle_counts >> bits == 0);
    }
    CHECK_NEAR(worst, 0, 0.501 * kLead / 8192);
  }
  // The error of the reading is uniform: mean 0, rms a count over sqrt 12.
  DriveSimulatorConfig c = axis();
  c.encoder.counts_per_turn = 131072;
  DriveSimulator s = made(c);
  Trajectory t;
  (void)t.move_to(1.0, {0.31, 5, 100});
  const double count = kLead / 131072;
  double sum = 0, squares = 0;
  int n = 0;
  for (const DriveSimSample& x :
       s.run(t.duration_s(), [&](double time) { return t.at(time).position; })) {
    if (x.velocity < 0.1) continue;  // many counts a sample, so that readings are independent
    const double e = (static_cast<double>(x.angle_counts) * count - x.position) / count;
    sum += e;
    squares += e * e;
    ++n;
  }
  CHECK_NEAR(sum / n, 0, 4 / std::sqrt(12.0 * n));
  CHECK_NEAR(squares / n, 1.0 / 12, 4 * std::sqrt(1.0 / 180 / n));
}

// Slow current, noise, seeds.
void reported_current() {
  DriveSimulatorConfig c = axis();
  c.current_update_hz = 2000;
  DriveSimulator slow = made(c);
  c.current_update_hz = 0;
  DriveSimulator fast = made(c);
  double held = 0;
  for (int n = 0; n < 1000; ++n) {
    const DriveSimSample a = slow.step(1e-3), b = fast.step(1e-3);
    CHECK(a.current_is_new == (n % 4 == 0) && b.current_is_new);
    if (n % 4 == 0) held = b.current_A;
    CHECK(a.current_A == held);
  }
  c.current_update_hz = 3000;  // not a divisor: 3 of every 8 samples
  DriveSimulator odd = made(c);
  int fresh = 0;
  for (int n = 0; n < 8000; ++n) fresh += odd.step(0).current_is_new ? 1 : 0;
  CHECK(fresh == 3000);

  c.current_update_hz = 0;
  c.current_noise_A = 0.2;
  c.encoder.counts_per_turn = 1 << 20;
  const auto run = [&](std::uint64_t seed) {
    c.seed = seed;
    DriveSimulator s = made(c);
    std::vector<double> all;
    for (int n = 0; n < 20000; ++n) {
      const DriveSimSample x = s.step(n < 100 ? 0 : 1e-3, n > 5000 ? 100 : 0);
      all.insert(all.end(), {x.current_A, x.position, static_cast<double>(x.angle_counts)});
    }
    return all;
  };
  const auto a = run(7), b = run(7), other = run(8);
  CHECK(std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0);
  CHECK(a != other);
  // Noise is on what is reported, not in the machine: the difference of two seeds is noise alone.
  double squares = 0;
  for (std::size_t i = 0; i < a.size(); i += 3) {
    squares += (a[i] - other[i]) * (a[i] - other[i]);
    CHECK(a[i + 1] == other[i + 1]);
  }
  const double variance = squares / 20000 / 2;
  CHECK_NEAR(variance, 0.04, 4 * 0.04 * std::sqrt(2.0 / 20000));
}

// A vertical axis stands still under gravity from the first sample, with play too.
void standing() {
  for (const bool with_play : {false, true}) {
    DriveSimulatorConfig c = axis();
    c.drive.constant_load = 175 * kGravity_m_s2;
    if (with_play) add(c, setting("backlash", {30e-6}));
    DriveSimulator s = made(c);
    for (int n = 0; n < 4000; ++n) {
      const DriveSimSample x = s.step(0);
      CHECK_NEAR(x.position, 0, 1e-12);
      CHECK_NEAR(x.current_A, 175 * kGravity_m_s2 / 200, 1e-9);
    }
  }
  const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
  // Nonsense in a reference or a force is replaced by the last good value, and does not stay.
  DriveSimulator s = made(axis());
  DriveSimulator clean = made(axis());
  for (int n = 0; n < 4000; ++n) {
    const bool bad = n > 100 && n % 7 == 0;
    const double x = s.step(bad ? nan : 1e-3, bad ? infinity : 20).position;
    CHECK(x == clean.step(1e-3, 20).position);
  }
}

void refusals() {
  const auto refused = [](auto&& change, const char* word) {
    DriveSimulatorConfig c = axis();
    change(c);
    const auto s = DriveSimulator::create(c);
    CHECK(!s);
    if (!s) CHECK(s.error().sentence.find(word) != std::string::npos);
  };
  using C = DriveSimulatorConfig;
  refused([](C& c) { c.drive.inertia = 0; }, "inertia");
  refused([](C& c) { c.drive.inertia = std::nan(""); }, "inertia");
  refused([](C& c) { c.drive.viscous = -1; }, "viscous");
  refused([](C& c) { c.sample_period_s = 0; }, "sample_period_s");
  refused([](C& c) { c.effort_per_A = 0; }, "effort_per_A");
  refused([](C& c) { c.controller.velocity_gain_A_s = -1; }, "velocity_gain");
  refused([](C& c) { c.controller.current_limit_A = 0; }, "current_limit_A");
  refused([](C& c) { c.controller.delay_s = -1; }, "delay_s");
  refused([](C& c) { c.encoder.counter_bits = 65; }, "counter_bits");
  refused([](C& c) { c.encoder.counts_per_turn = 8192, c.drive.unit_per_turn = 0; },
          "unit_per_turn");
  refused([](C& c) { c.current_update_hz = 9000; }, "current_update_hz");
  refused([](C& c) { c.drive.friction_knee = 0; }, "friction_knee");
  refused([](C& c) { c.drive.coulomb = 1e8, c.drive.friction_knee = 1e-10; }, "steps");
  refused([](C& c) { c.drive.coulomb = 1e6, c.substeps = 1; }, "steps");
  refused([](C& c) { add(c, setting("backlash", {-1})); }, "width_m");
}

}  // namespace

int main() {
  against_runge_kutta();
  against_closed_form();
  convergence_with_friction();
  stiction();
  books();
  two_masses();
  play();
  current_limit();
  encoder();
  reported_current();
  standing();
  refusals();
  return check::done();
}
