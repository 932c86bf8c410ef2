// The cut with drives around it: the bare milling simulator where drives are ideal or heavy,
// closed forms of equilibrium, droop and energy, the program of a record, and the closed loop
// through encoder, current and observers back to torque, force and chatter.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <memory>
#include <random>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "check.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/monitors/chatter.hpp"
#include "servosense/observer/disturbance_observer.hpp"
#include "servosense/observer/drive_config.hpp"
#include "servosense/sim/machine_simulator.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod = 125e-6;
constexpr double kNone = std::numeric_limits<double>::infinity();

template <typename T>
T good(Expected<T> result) {
  if (!result) {
    check::fail(__FILE__, __LINE__) << result.error().sentence << '\n';
    std::exit(check::done());
  }
  return *std::move(result);
}

MachineSimulator ready(const MachineSimulation& s) { return good(MachineSimulator::create(s)); }

std::vector<MachineSample> record(const MachineSimulation& s) { return good(ready(s).run()); }

// Four straight teeth in a slot load the tool with a constant force.
MillingSimulation slot() {
  MillingSimulation s;
  s.tool.diameter_m = 20e-3;
  s.tool.teeth = 4;
  s.tool.force.tangential_coefficient_N_per_m2 = 600e6;
  s.tool.force.radial_ratio = 0.3;
  s.cut = {3000, 50e-6, 4e-3, 0, MillingDirection::slot};
  s.workpiece.length_m = 20e-3;
  s.start = MillingStart::entry;
  s.clearance_m = 2e-3;
  s.step_s = 1e-5;
  s.layers = 1;
  return s;
}
// Its force along y, and 0.3 times that against the feed (milling_dynamics), and mean torque:
// Kt a s N/2pi R times the integral of sin over the slot.
constexpr double kForce_N = 600e6 * 4e-3 * 50e-6;
constexpr double kTorque_Nm = kForce_N * 4 / kPi * 10e-3;

// Koike 2016, tables 3-1 and 3-4, with torque constants and gains of our own choice.
DriveSimulatorConfig spindle() {
  DriveSimulatorConfig c;
  c.drive.inertia = 0.0048;
  c.drive.viscous = 4.775e-4;
  c.drive.coulomb = 0.1062;
  c.drive.friction_knee = 1e-3;
  c.drive.unit_per_turn = kTwoPi;
  c.effort_per_A = 0.5;
  c.controller.velocity_gain_A_s = 2;
  c.controller.velocity_integral_per_s = 20;
  c.controller.current_bandwidth_hz = 1000;
  return c;
}

DriveSimulatorConfig axis() {
  DriveSimulatorConfig c;
  c.drive.inertia = 227;
  c.drive.viscous = 732;
  c.drive.coulomb = 94;
  c.drive.unit_per_turn = 0.016;
  c.effort_per_A = 314;
  c.controller.position_gain_per_s = 40;
  c.controller.velocity_gain_A_s = 200;
  c.controller.velocity_integral_per_s = 60;
  c.controller.current_bandwidth_hz = 1000;
  return c;
}

MachineSimulation machine() {
  MachineSimulation m;
  m.milling = slot();
  m.spindle = spindle();
  m.x = axis();
  m.y = axis();
  m.z = axis();
  m.program.spindle_acceleration_rad_s2 = 1000;
  m.program.dwell_s = 0.1;
  m.program.feed_acceleration_m_s2 = 1;
  m.program.feed_jerk_m_s3 = 100;
  return m;
}

// What a drive with counter, slow current and noise adds to the ideal signals.
void add_sensors(DriveSimulatorConfig& c, double counts, double noise_A, std::uint64_t seed) {
  c.encoder.counts_per_turn = counts;
  c.encoder.counter_bits = 24;  // wraps
  c.encoder.initial_counts = 77;
  c.current_update_hz = 2000;
  c.current_noise_A = noise_A;
  c.seed = seed;
}

template <typename Value>
double mean(const std::vector<MachineSample>& samples, double from_s, double to_s, Value value) {
  double sum = 0, count = 0;
  for (const MachineSample& s : samples)
    if (s.t_s >= from_s && s.t_s < to_s) {
      sum += value(s);
      count += 1;
    }
  return sum / count;
}

bool same_cut(const MillingStep& a, const MillingStep& b) {
  return a.t_s == b.t_s && a.angle_rad == b.angle_rad &&
         a.spindle_speed_rad_s == b.spindle_speed_rad_s && a.feed_m == b.feed_m &&
         a.fx_N == b.fx_N && a.fy_N == b.fy_N && a.torque_Nm == b.torque_Nm && a.x_m == b.x_m &&
         a.y_m == b.y_m && a.vx_m_s == b.vx_m_s && a.vy_m_s == b.vy_m_s &&
         a.teeth_in_cut == b.teeth_in_cut;
}

// Without drives and approach every row is a row of MillingSimulator::run, bit for bit.
void ideal_drives_are_the_bare_cut() {
  const unsigned seed = 71;
  std::mt19937_64 random(seed);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int i = 0; i < 12; ++i) {
    MachineSimulation m;
    MillingSimulation& s = m.milling;
    s = slot();
    s.tool.teeth = 1 + i % 4;
    s.tool.helix_deg = between(0, 40);
    s.cut.spindle_speed_rpm = between(1000, 6000);
    s.cut.axial_depth_m = between(0.1e-3, 0.4e-3);
    s.structure.x = {{600, 0.03, 0.4}};
    s.structure.y = {{660, 0.03, 0.4}};
    s.layers = 4;
    s.step_s = i % 2 == 0 ? 1e-5 : 2e-6;
    s.workpiece = {};
    if (i % 3 != 0) {
      s.start = MillingStart::immersed;
      s.speed = SpindleSpeedProfile::ramp(s.cut.spindle_speed_rpm, 0.8 * s.cut.spindle_speed_rpm,
                                          100, s.cut.spindle_speed_rpm);
      s.breaks = {{0.05, 1, 0.7}};
    } else {
      s.clearance_m = 20e-6;
      s.workpiece.length_m = 1;
    }
    m.program.cut_s = 0.1;
    auto bare = good(MillingSimulator::create(s));
    const auto expected = good(bare.run(0.1, 1 / kPeriod));
    MachineSimulator coupled = ready(m);
    (void)coupled.step();
    bool same = expected.size() == 800;
    double force = 0;
    for (const MillingStep& row : expected) {
      same = same && same_cut(coupled.step().cut, row);
      force = std::max(force, std::abs(row.fy_N));
    }
    if (!same) check::fail(__FILE__, __LINE__) << "seed " << seed << ", cut " << i << " differs\n";
    CHECK(same && force > 1);
  }
}

// Drives a million times as heavy as the cut could move: from any instant in the air on, the cut is
// that of the bare simulator which starts there.
void heavy_drives_are_the_bare_cut() {
  double off[2] = {};
  for (int heavier = 0; heavier < 2; ++heavier) {
    MachineSimulation m = machine();
    m.milling.tool.teeth = 3;  // forces that vary
    m.milling.tool.helix_deg = 20;
    m.milling.layers = 8;
    m.milling.structure.x = {{600, 0.03, 4}};
    m.milling.structure.y = {{660, 0.03, 4}};
    m.milling.step_s = 12.5e-6;
    m.milling.clearance_m = 4e-3;  // the lag of x has 0.4 s to settle, at 40/s
    m.program.cut_s = 0.3;
    const double factor = heavier == 0 ? 1e4 : 1e6;
    for (DriveSimulatorConfig* c : {&*m.spindle, &*m.x}) {
      c->drive.coulomb = c->drive.viscous = 0;
      c->drive.inertia *= factor;
      c->controller.velocity_gain_A_s *= factor;
      c->controller.velocity_integral_per_s = 0;
    }
    MachineSimulator coupled = ready(m);
    MachineSample now = coupled.step();
    while (now.t_s < coupled.schedule().contact_s) now = coupled.step();
    CHECK(now.cut.fy_N == 0);
    MillingSimulation s = m.milling;
    s.start_angle_rad = now.cut.angle_rad;
    const double contact_m = s.clearance_m + good(MillingSimulator::create(s)).now().feed_m;
    s.clearance_m = contact_m - now.cut.feed_m;
    CHECK(s.clearance_m > 0);
    auto bare = good(MillingSimulator::create(s));
    const auto expected = good(bare.run(0.25, 1 / kPeriod));
    double peak = 0;
    for (const MillingStep& row : expected) {
      const MillingStep cut = coupled.step().cut;
      off[heavier] = std::max({off[heavier], std::abs(cut.torque_Nm - row.torque_Nm) / kTorque_Nm,
                               std::abs(cut.fx_N - row.fx_N) / kForce_N,
                               std::abs(cut.fy_N - row.fy_N) / kForce_N});
      peak = std::max(peak, row.torque_Nm);
    }
    CHECK(peak > kTorque_Nm / 4);
    check::figure("heavy drives: largest difference from the bare cut", off[heavier]);
  }
  // Drives give way as the inverse of their inertia, down to the rounding of angle and feed.
  CHECK_BETWEEN(off[0], 1e-6, 1e-4);
  CHECK_BETWEEN(off[1], 0, off[0] / 20);
}

// Constant forces: what the motors must give is friction plus the push, with its sign; whichever
// of the drives are there.
void static_equilibrium() {
  const double feed = 50e-6 * 4 * 50, w = kTwoPi * 50;
  for (const bool with_spindle : {true, false})
    for (const bool with_axes : {true, false}) {
      MachineSimulation m = machine();
      m.milling.workpiece = {};
      m.program.cut_s = 2.5;
      m.y->drive.coulomb = m.z->drive.coulomb = 0;
      // Without them z feels nothing of the cut. Means of sin and of 1 over the slot.
      double axial_N = 0;
      if (with_spindle) {
        m.milling.tool.force.axial_coefficient_N_per_m2 = 150e6;
        m.milling.tool.force.axial_edge_N_per_m = 2000;
        axial_N = 4 * 4e-3 / kTwoPi * (150e6 * 50e-6 * 2 + 2000 * kTwoPi / 2);
      }
      if (!with_spindle) m.spindle.reset();
      if (!with_axes) m.x.reset(), m.y.reset(), m.z.reset();
      const auto samples = record(m);
      const double end = ready(m).schedule().stop_s;
      const auto steady = [&](auto value) {  // 20 whole revolutions of a full slot
        return mean(samples, end - 0.4, end, value);
      };
      // The work pushes against the feed and toward +y; the motor of y pulls back.
      if (with_axes) {
        CHECK_NEAR(314 * steady([](auto& s) { return s.x->current_A; }),
                   732 * feed + 94 + 0.3 * kForce_N, 1e-3 * kForce_N);
        CHECK_NEAR(314 * steady([](auto& s) { return s.y->current_A; }), -kForce_N,
                   1e-3 * kForce_N);
        CHECK_NEAR(314 * steady([](auto& s) { return s.z->current_A; }), -axial_N,
                   1e-3 * axial_N + 1e-9);
      }
      if (with_spindle)
        CHECK_NEAR(0.5 * steady([](auto& s) { return s.spindle->current_A; }),
                   4.775e-4 * w + 0.1062 + kTorque_Nm, 1e-3 * kTorque_Nm);
      CHECK_NEAR(steady([](auto& s) { return s.cut.torque_Nm; }), kTorque_Nm, 1e-3 * kTorque_Nm);
      CHECK_NEAR(steady([](auto& s) { return s.cut.fx_N; }), -0.3 * kForce_N, 1e-3 * kForce_N);
    }
}

// Without an integrator the spindle droops until the gain makes up for torque and friction. The
// feed is kept, so the chips grow: T = T0 w_ref / w, a quadratic for w.
void spindle_droop() {
  MachineSimulation m = machine();
  m.milling.workpiece = {};
  m.program.cut_s = 2.5;
  m.spindle->controller.velocity_integral_per_s = 0;
  m.spindle->controller.velocity_gain_A_s = 0.2;
  m.program.dwell_s = 0.6;  // 12 time constants J / (K gain)
  const auto samples = record(m);
  const double end = ready(m).schedule().stop_s;
  const double gain = 0.2 * 0.5, D = 4.775e-4, w_ref = kTwoPi * 50;
  const double b = gain * w_ref - 0.1062;
  const double air = b / (gain + D);
  const double w = (b + std::sqrt(b * b - 4 * (gain + D) * kTorque_Nm * w_ref)) / (2 * (gain + D));
  const auto speed = [](const MachineSample& s) { return s.spindle->velocity; };
  const double contact = ready(m).schedule().contact_s;
  check::figure("droop in the air and in the cut", w_ref - air, "rad/s");
  check::figure("", w_ref - w, "rad/s");
  CHECK_NEAR(mean(samples, contact - 0.02, contact, speed), air, 1e-3 * (w_ref - air));
  CHECK_NEAR(mean(samples, end - 0.4, end, speed), w, 1e-3 * (w_ref - w));
  const auto torque = mean(samples, end - 0.4, end, [](auto& s) { return s.cut.torque_Nm; });
  CHECK_NEAR(torque, kTorque_Nm * w_ref / w, 1e-3 * kTorque_Nm);
}

// With an integrator no speed is lost but angle: K gain integral times it carries the torque.
void angle_lost_to_the_cut() {
  MachineSimulation m = machine();
  m.milling.workpiece = {};
  m.program.cut_s = 2.5;
  m.program.dwell_s = 0.6;
  MachineSimulator simulator = ready(m);
  double commanded = 0;
  double in_air = 0, in_cut = 0, n_air = 0, n_cut = 0;
  const CutSchedule& plan = simulator.schedule();
  (void)good(simulator.run([&](const MachineSample& s) -> Expected<Done> {
    // The controller adds up reference minus backward difference: exact with this sum.
    commanded += s.spindle_reference_rad_s * kPeriod;
    const double behind = commanded - s.spindle->position;
    if (s.t_s >= plan.contact_s - 0.1 && s.t_s < plan.contact_s) in_air += behind, n_air += 1;
    if (s.t_s >= plan.stop_s - 0.4 && s.t_s < plan.stop_s) in_cut += behind, n_cut += 1;
    return Done{};
  }));
  const double expected = kTorque_Nm / (0.5 * 2 * 20);
  check::figure("angle lost", in_cut / n_cut - in_air / n_air, "rad");
  CHECK_NEAR(in_cut / n_cut - in_air / n_air, expected, 2e-3 * expected);
}

// A slot through a block, from rest to rest.
void energy_of_a_whole_slot() {
  MachineSimulation m = machine();
  m.milling.tool.helix_deg = 30;
  m.milling.layers = 8;
  const auto samples = record(m);
  double spindle_motor = 0, x_motor = 0, lost = 0, spindle_cut = 0, x_cut = 0, chips = 0;
  double push = 0, worst_turn = 0, worst_feed = 0, spindle_rate = 0, feed_rate = 0;
  const double stop_s = ready(m).schedule().stop_s;
  for (std::size_t i = 0; i + 1 < samples.size(); ++i) {
    const MachineSample& a = samples[i];
    const MachineSample& b = samples[i + 1];
    const double turn = b.spindle->position - a.spindle->position;
    const double feed = b.x->position - a.x->position;
    spindle_motor += a.spindle->effort * turn;
    x_motor += a.x->effort * feed;
    lost += a.spindle->resistance * turn + a.x->resistance * feed;
    spindle_cut += a.spindle->cutting * turn;
    x_cut += a.x->cutting * feed;
    // On the side of the cut.
    chips += b.cut.torque_Nm * (b.cut.angle_rad - a.cut.angle_rad);
    push -= b.cut.fx_N * (b.cut.feed_m - a.cut.feed_m);
    if (b.t_s > stop_s) continue;
    const double later = b.cut.t_s - b.t_s;  // steps of the cut do not end with the period
    worst_turn = std::max(
        worst_turn, std::abs(b.cut.angle_rad - b.spindle->position - later * b.spindle->velocity));
    worst_feed = std::max(worst_feed, std::abs(b.cut.feed_m - samples[0].cut.feed_m -
                                               b.x->position - later * b.x->velocity));
    const auto rate = [](double after, double before) {
      return std::abs(after - before) / kPeriod;
    };
    spindle_rate = std::max(spindle_rate, rate(b.spindle->velocity, a.spindle->velocity));
    feed_rate = std::max(feed_rate, rate(b.x->velocity, a.x->velocity));
  }
  // A tangential force Kt per area of chip makes Kt the energy of every volume removed. A tooth
  // that meets the front face takes its full chip at once: half a feed per tooth too much. At both
  // walls, part of a layer.
  const double volume = 20e-3 * 4e-3 * 20e-3;
  check::figure("energy of the slot, on the side of the cut", chips, "J");
  CHECK_NEAR(chips, 600e6 * volume, 2e-3 * 600e6 * volume);
  // The tool is off its spindle by 3 T^2 times the acceleration and a step of its own, either way:
  // below a thousandth of the work between two teeth. The books of the drives are closed.
  const double w = samples.back().spindle->velocity, v = samples.back().x->velocity;
  const double moving = 0.0048 / 2 * w * w + 227.0 / 2 * v * v;
  check::figure("lost in the coupling of the spindle", spindle_cut / chips - 1);
  check::figure("lost in the coupling of x", x_cut / push - 1);
  CHECK_NEAR(spindle_cut, chips, 1e-3 * chips);
  CHECK_NEAR(x_cut, push, 1e-4 * chips);
  CHECK(push > 0 && std::abs(w) < 1 && std::abs(v) < 1e-4);
  check::figure("lost in the drives",
                (lost + spindle_cut + x_cut + moving) / (spindle_motor + x_motor) - 1);
  CHECK_NEAR(lost + spindle_cut + x_cut + moving, spindle_motor + x_motor,
             1e-6 * (spindle_motor + x_motor));
  // A straight line led p periods on leaves p (p + 1) / 2 of T^2 times the acceleration; p is two
  // and up to a step. The accelerations are means of periods, those at their ends a little more.
  check::figure("tool off its spindle, at most", worst_turn, "rad");
  check::figure("tool off its feed axis, at most", worst_feed, "m");
  const double p = 2 + m.milling.step_s / kPeriod;
  const double most = 1.05 * p * (p + 1) / 2 * kPeriod * kPeriod;
  CHECK_BETWEEN(worst_turn, 0, most * spindle_rate);
  CHECK_BETWEEN(worst_feed, 0, most * feed_rate);
}

// The same for cuts, drives and programs drawn at random.
void energy_of_random_cuts(unsigned seed, int count) {
  std::mt19937_64 random(seed);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  double worst_chips = 0, worst_spindle = 0, worst_x = 0, worst_books = 0;
  for (int i = 0; i < count; ++i) {
    MachineSimulation m = machine();
    MillingSimulation& c = m.milling;
    const MillingDirection directions[] = {MillingDirection::up, MillingDirection::down,
                                           MillingDirection::slot};
    c.cut.direction = directions[i % 3];
    c.cut.radial_immersion_m = between(2e-3, 18e-3);
    c.cut.axial_depth_m = between(1e-3, 8e-3);
    c.cut.feed_per_tooth_m = between(20e-6, 60e-6);
    c.cut.spindle_speed_rpm = between(2000, 6000);
    c.tool.teeth = std::uniform_int_distribution<int>(1, 5)(random);
    c.tool.helix_deg = between(0, 40);
    c.tool.force.radial_ratio = between(0, 0.5);
    c.layers = 16;
    c.workpiece.length_m = between(10e-3, 15e-3);
    m.spindle->drive.inertia *= between(0.5, 4);
    m.x->drive.inertia *= between(0.3, 2);
    m.x->controller.position_gain_per_s = between(20, 60);
    m.program.spindle_acceleration_rad_s2 = between(500, 3000);
    m.program.holds = {{between(0.3, 0.4), between(0, 0.1)}};
    const auto samples = record(m);
    double chips = 0, push = 0, spindle_cut = 0, x_cut = 0, motors = 0, lost = 0;
    for (std::size_t n = 0; n + 1 < samples.size(); ++n) {
      const MachineSample& a = samples[n];
      const MachineSample& b = samples[n + 1];
      const double turn = b.spindle->position - a.spindle->position;
      const double feed = b.x->position - a.x->position;
      chips += b.cut.torque_Nm * (b.cut.angle_rad - a.cut.angle_rad);
      push -= b.cut.fx_N * (b.cut.feed_m - a.cut.feed_m);
      spindle_cut += a.spindle->cutting * turn;
      x_cut += a.x->cutting * feed;
      motors += a.spindle->effort * turn + a.x->effort * feed;
      lost += a.spindle->resistance * turn + a.x->resistance * feed;
    }
    const double w = samples.back().spindle->velocity, v = samples.back().x->velocity;
    const double moving = m.spindle->drive.inertia / 2 * w * w + m.x->drive.inertia / 2 * v * v;
    const double wide =
        c.cut.direction == MillingDirection::slot ? c.tool.diameter_m : c.cut.radial_immersion_m;
    const double expected = 600e6 * c.workpiece.length_m * c.cut.axial_depth_m * wide;
    worst_chips = std::max(worst_chips, std::abs(chips / expected - 1));
    worst_spindle = std::max(worst_spindle, std::abs(spindle_cut / chips - 1));
    worst_x = std::max(worst_x, std::abs(x_cut - push) / chips);
    worst_books =
        std::max(worst_books, std::abs((lost + spindle_cut + x_cut + moving) / motors - 1));
  }
  std::printf("  random cuts, seed %u: %d\n", seed, count);
  check::figure("chips against Kt times volume", worst_chips);
  check::figure("lost in the coupling of the spindle", worst_spindle);
  check::figure("lost in the coupling of x, of the chips' energy", worst_x);
  check::figure("lost in the drives", worst_books);
  CHECK(worst_chips < 2e-3);
  CHECK(worst_spindle < 1e-3);
  CHECK(worst_x < 1e-4);
  CHECK(worst_books < 1e-6);
}

// ---- Closed loop: through counter, slow and noisy current, trace text and observer.

struct Observed {
  std::vector<double> t_s, estimate, increment, angle, truth;
  std::vector<Quality> quality;
};

// What the observer makes of one drive of a written record.
Observed observe(const Trace& trace, Channel channel, const DriveInputConfig& input_config,
                 const DisturbanceObserverConfig& config, Signal truth, double sign) {
  DriveInput<double> input;
  DisturbanceObserver<double> observer;
  CHECK_TEXT(DriveInput<double>::validate(input_config).reason(), "");
  CHECK_TEXT(DisturbanceObserver<double>::validate(config).reason(), "");
  input.configure(input_config);
  observer.configure(config);
  const auto index = [&](Signal signal) {
    const auto at = std::find(trace.signals.begin(), trace.signals.end(), signal);
    CHECK(at != trace.signals.end());
    return static_cast<std::size_t>(at - trace.signals.begin());
  };
  const std::size_t counts = index({channel, Quantity::angle_counts});
  const std::size_t current = index({channel, Quantity::current_A});
  const std::size_t cut = index(truth);
  Observed o;
  for (std::size_t i = 0; i < trace.size(); ++i) {
    RawDriveSample<double> raw;
    raw.counts = trace.counts[counts][i];
    raw.effort = trace.columns[current][i];
    if (!trace.updated[current][i]) raw.effort_quality = Quality::held;
    const DriveSample<double> sample = input.process(raw);
    o.t_s.push_back(trace.t_s[i]);
    o.estimate.push_back(observer.process(sample));
    o.increment.push_back(sample.increment);
    o.angle.push_back(sample.turn_angle_rad);
    o.quality.push_back(observer.state().quality);
    o.truth.push_back(sign * trace.columns[cut][i]);
  }
  return o;
}

Trace written(const MachineSimulation& m, std::string* text = nullptr) {
  MachineSimulator simulator = ready(m);
  auto out = std::make_unique<std::stringstream>();
  auto writer = good(
      TraceWriter::to_stream(*out, "record", record_signals(m, true), record_metadata(simulator)));
  (void)good(write_record(simulator, writer));
  (void)good(writer.close());
  if (text != nullptr) *text = out->str();
  auto reader = good(TraceReader::from_stream(std::move(out), "record"));
  return good(read_trace(reader));
}

SpindleConfig spindle_of(const DriveSimulatorConfig& c) {
  SpindleConfig s;
  s.torque_constant_Nm_per_A = c.effort_per_A;
  s.inertia_kg_m2 = c.drive.inertia;
  s.viscous_friction_Nm_s_per_rad = c.drive.viscous;
  s.coulomb_friction_Nm = c.drive.coulomb;
  s.encoder_counts_per_rev = c.encoder.counts_per_turn;
  s.counter_bits = c.encoder.counter_bits;
  return s;
}

AxisConfig axis_of(const DriveSimulatorConfig& c) {
  AxisConfig a;
  a.lead_m = c.drive.unit_per_turn;
  a.equivalent_mass_kg = c.drive.inertia;
  a.viscous_friction_N_s_per_m = c.drive.viscous;
  a.coulomb_friction_N = c.drive.coulomb;
  a.force_constant_N_per_A = c.effort_per_A;
  a.encoder_counts_per_rev = c.encoder.counts_per_turn;
  a.counter_bits = c.encoder.counter_bits;
  return a;
}

constexpr DriveSignal kReported{MotionKind::counts, EffortKind::current_A};

// Mean over blocks of whole revolutions.
struct Blocks {
  double mean = 0, truth = 0;
  double spread = 0;  // of the means
  double worst = 0;   // farthest mean from its truth
  double noise = 0;   // standard deviation of single samples
  int count = 0;
};
Blocks blocks(const Observed& o, double from_s, double to_s, std::size_t length) {
  std::vector<double> means;
  Blocks b;
  double sum_all = 0, squares = 0;
  for (std::size_t i = 0; i + length <= o.t_s.size(); ++i) {
    if (o.t_s[i] < from_s) continue;
    if (o.t_s[i + length - 1] > to_s) break;
    double sum = 0, truth = 0;
    for (std::size_t j = i; j < i + length; ++j) {
      sum += o.estimate[j];
      squares += o.estimate[j] * o.estimate[j];
      truth += o.truth[j];
    }
    const auto n = static_cast<double>(length);
    means.push_back(sum / n);
    b.worst = std::max(b.worst, std::abs(sum - truth) / n);
    b.truth += truth;
    sum_all += sum;
    i += length - 1;
  }
  b.count = static_cast<int>(means.size());
  const double n = b.count * static_cast<double>(length);
  b.mean = sum_all / n;
  b.truth /= n;
  b.noise = std::sqrt(std::max(0.0, squares / n - b.mean * b.mean));
  for (const double m : means) b.spread += (m - b.mean) * (m - b.mean) / (b.count - 1);
  b.spread = std::sqrt(b.spread);
  return b;
}

void observers_get_the_cut_back() {
  for (const double current_hz : {1 / kPeriod, 2000.0}) {
    MachineSimulation m = machine();
    m.milling.workpiece.length_m = 40e-3;
    m.milling.clearance_m = 10e-3;
    m.milling.tool.helix_deg = 30;
    m.milling.layers = 8;
    m.program.dwell_s = 0.8;
    add_sensors(*m.spindle, 131072, 0.02, 3);
    add_sensors(*m.x, 1048576, 0.05, 4);
    add_sensors(*m.y, 1048576, 0.05, 5);
    for (DriveSimulatorConfig* c : {&*m.spindle, &*m.x, &*m.y}) c->current_update_hz = current_hz;
    m.y->drive.coulomb = 0;  // at rest nobody knows which way friction holds
    const Trace trace = written(m);
    const CutSchedule plan = ready(m).schedule();
    std::printf("  current at %g Hz\n", current_hz);
    const auto drive = [&](const char* name, Channel channel, const DriveInputConfig& input,
                           const DisturbanceObserverConfig& observer, Signal truth, double sign) {
      const Observed o = observe(trace, channel, input, observer, truth, sign);
      // 50 revolutions a second, 160 samples each. The slot is full from 1 s to 4 s after contact.
      const Blocks air = blocks(o, plan.contact_s - 0.7, plan.contact_s, 160);
      const Blocks cut = blocks(o, plan.contact_s + 2.5, plan.contact_s + 3.9, 160);
      CHECK(air.count >= 30 && cut.count >= 60);
      std::printf("  %-14s air %9.4f (noise %.3g, of revolutions %.3g), cut %9.4f, truth %9.4f\n",
                  name, air.mean, air.noise, air.spread, cut.mean, cut.truth);
      // Every revolution within four times the noise of a sample in the air.
      CHECK_BETWEEN(cut.worst, 0, 4 * air.noise);
      CHECK_NEAR(air.mean, 0, air.noise);
      // A slow current samples the ripple that the counter puts into it always at the same phases:
      // an offset within that noise. At the servo rate nothing but chance is left: four standard
      // errors of a mean over revolutions.
      const double chance = 4 * air.spread / std::sqrt(cut.count);
      CHECK_NEAR(cut.mean, cut.truth, current_hz < 8000 ? air.noise : chance);
      bool fine = true;
      for (std::size_t i = 400; i < o.quality.size(); ++i)
        fine = fine && !has(o.quality[i], kUnusable) && !has(o.quality[i], Quality::gap);
      CHECK(fine);
    };
    const SpindleConfig s = spindle_of(*m.spindle);
    const AxisConfig x = axis_of(*m.x), y = axis_of(*m.y);
    drive("spindle torque", Channel::spindle, s.input(kReported, kPeriod),
          s.disturbance_observer(kPeriod, s.observer), {Channel::tool, Quantity::torque_Nm}, 1);
    drive("x force", Channel::x, x.input(kReported, kPeriod),
          x.disturbance_observer(kPeriod, x.observer), {Channel::tool, Quantity::force_x_N}, -1);
    drive("y force", Channel::y, y.input(kReported, kPeriod),
          y.disturbance_observer(kPeriod, y.observer), {Channel::tool, Quantity::force_y_N}, -1);
  }
}

// Stable and unstable depths, told apart by the counter and current of the spindle alone. Which is
// which the tool itself says: a stable cut repeats with the revolution. The counter has 2^23 parts;
// with 2^17 the noise of a difference of counts, J count / T^2 = 15 Nm, hides this chatter.
void chatter_is_seen_in_the_drive() {
  for (const double depth_m : {1e-3, 1.5e-3, 3e-3, 4e-3}) {
    MachineSimulation m = machine();
    MillingSimulation& c = m.milling;
    c.cut.axial_depth_m = depth_m;
    c.tool.helix_deg = 30;
    c.layers = 16;
    c.structure.x = {{600, 0.03, 1}};
    c.structure.y = {{660, 0.03, 1}};
    m.program.dwell_s = 0.4;
    add_sensors(*m.spindle, 8388608, 0.02, 3);
    m.spindle->encoder.counter_bits = 32;
    const Trace trace = written(m);
    const CutSchedule plan = ready(m).schedule();
    const SpindleConfig s = spindle_of(*m.spindle);
    const Observed o = observe(trace, Channel::spindle, s.input(kReported, kPeriod),
                               s.disturbance_observer(kPeriod, {3500, 3500}),
                               {Channel::tool, Quantity::torque_Nm}, 1);
    using Monitor = ChatterMonitor<double, 16, 20, 1400>;
    const auto watch = [&](double threshold, double from_s, double to_s) {
      ChatterConfig config;
      config.harmonics = 20;
      config.teeth = static_cast<unsigned>(c.tool.teeth);
      config.chatter_threshold_Nm2 = threshold;
      CHECK_TEXT(Monitor::validate(config).reason(), "");
      auto monitor = std::make_unique<Monitor>();
      monitor->configure(config);
      double most = 0;
      for (std::size_t i = 0; i < o.t_s.size(); ++i)
        if (o.t_s[i] >= from_s && o.t_s[i] < to_s) {
          monitor->process(o.estimate[i], o.angle[i], o.increment[i], o.quality[i]);
          most = std::max(most, monitor->state().chatter_Nm2);
        }
      return std::pair(most, monitor->state().alarms);
    };
    // The threshold is ten times what is there in the air. The slot is full from 1 s to 2 s after
    // contact (while it opens, blows on the edges of the arc are no harmonics below the 20th).
    const double air = watch(0, plan.contact_s - 0.4, plan.contact_s).first;
    const auto [cut, alarms] = watch(10 * air, plan.contact_s + 1.1, plan.contact_s + 2);
    const std::vector<double>& x = *trace.find({Channel::tool, Quantity::displacement_x_m});
    double unlike = 0, most = 0;  // of this and the last revolution
    for (std::size_t i = 0; i < o.t_s.size(); ++i)
      if (o.t_s[i] >= plan.contact_s + 1.5 && o.t_s[i] < plan.contact_s + 2) {
        unlike = std::max(unlike, std::abs(x[i] - x[i - 160]));
        most = std::max(most, std::abs(x[i]));
      }
    std::printf(
        "  %.1f mm deep: chatter power %.3g in the air, %.3g in the cut; x unlike the last "
        "revolution by %.2g of %.2g um\n",
        depth_m * 1e3, air, cut, unlike * 1e6, most * 1e6);
    const bool stable = depth_m < 2e-3;
    CHECK(stable ? unlike < 0.1 * most : unlike > 0.5 * most);
    CHECK(stable ? alarms == 0 : alarms == 1);
  }
}

// ---- Program and events.

void a_whole_record() {
  const MachineSimulation m = machine();
  const CutSchedule plan = ready(m).schedule();
  const auto samples = record(m);
  // Run-up 0.1 pi s, dwell, then the feed of 10 mm/s along a ramp of jerk 100 m/s3.
  const double feed = 10e-3, ramp = 2 * std::sqrt(feed / 100);
  CHECK_NEAR(plan.feed_s, kTwoPi * 50 / 1000 + 0.1, 1e-12);
  CHECK_NEAR(plan.contact_s, plan.feed_s + ramp / 2 + 2e-3 / feed, 1e-12);
  // To the far face, the radius and the clearance, where it comes to rest.
  CHECK_NEAR(samples.back().feed_reference_m, 20e-3 + 10e-3 + 2e-3, 1.01 * feed * kPeriod);
  CHECK_NEAR(samples.back().x->position - samples.front().x->position, 12e-3 + 32e-3,
             1.01 * feed * kPeriod);
  CHECK_NEAR(plan.run_down_s, plan.stop_s + ramp + 0.1, 1e-12);
  CHECK_NEAR(plan.end_s, plan.run_down_s + kTwoPi * 50 / 1000 + 0.1, 1e-12);
  CHECK_NEAR(samples.back().t_s, plan.end_s, kPeriod);
  double first = kNone, last = 0;
  for (const MachineSample& s : samples)
    if (s.cut.torque_Nm > 0) {
      first = std::min(first, s.t_s);
      last = s.t_s;
    }
  // The axis lags by 1/40 s; teeth come by every 5 ms, and reach the walls of the exit likewise.
  CHECK_BETWEEN(first, plan.contact_s + 0.0245, plan.contact_s + 0.0305);
  CHECK_BETWEEN(last, plan.contact_s + 3 + 0.0195, plan.contact_s + 3 + 0.0255);
  const auto still = [&](double from, double to) {
    return mean(samples, from, to, [](auto& s) { return std::abs(s.x->velocity); });
  };
  CHECK(still(0, plan.feed_s) == 0 && samples.front().spindle->velocity == 0);
  CHECK_NEAR(
      mean(samples, plan.contact_s - 0.01, plan.contact_s, [](auto& s) { return s.x->velocity; }),
      feed, 0.01 * feed);
}

// The feed stops and starts again: no chips meanwhile, no way lost.
void feed_hold() {
  MachineSimulation m = machine();
  m.milling.workpiece = {};
  m.program.cut_s = 3.5;
  m.program.holds = {{1.4, 0.5}, {2.5, 0}};
  const auto samples = record(m);
  const CutSchedule plan = ready(m).schedule();
  const double feed = 10e-3, ramp = 2 * std::sqrt(feed / 100);
  const double way = feed * (plan.stop_s - plan.feed_s - 2 * ramp - 0.5);
  CHECK_NEAR(samples.back().feed_reference_m - samples.front().feed_reference_m, way, 1e-12);
  CHECK_NEAR(samples.back().x->position - samples.front().x->position, way, 1e-7);
  const auto torque = [](const MachineSample& s) { return s.cut.torque_Nm; };
  const double t = plan.contact_s;
  CHECK_NEAR(mean(samples, t + 1.2, t + 1.4, torque), kTorque_Nm, 1e-2 * kTorque_Nm);
  // The axis creeps on by its lag for some time constants of 25 ms.
  CHECK_NEAR(mean(samples, t + 1.8, t + 1.88, torque), 0, 1e-3 * kTorque_Nm);
  CHECK_NEAR(mean(samples, t + 1.8, t + 1.88, [](auto& s) { return s.spindle->velocity; }),
             kTwoPi * 50, 0.5);
  CHECK_NEAR(mean(samples, t + 2.3, t + 2.5, torque), kTorque_Nm, 1e-2 * kTorque_Nm);
  CHECK_NEAR(mean(samples, t + 3.3, t + 3.5, torque), kTorque_Nm, 1e-2 * kTorque_Nm);
}

// Overrides stretch the program, and leave its way as it is.
void overrides() {
  MachineSimulation m = machine();
  m.milling.workpiece = {};
  m.program.cut_s = 3;
  auto simulator = ready(m);
  const CutSchedule plan = simulator.schedule();
  // A second after the contact all of the tool is in.
  const double feed = 10e-3, t = plan.contact_s + 1;
  std::vector<MachineSample> samples;
  CHECK(simulator.run([&](const MachineSample& s) -> Expected<Done> {
    samples.push_back(s);
    MachineOverride set;
    if (s.t_s >= t + 0.5) set.speed = 0.8;
    if (s.t_s >= t + 0.5 && s.t_s < t + 1.5) set.feed = 0.5;
    set.hold = s.t_s >= t + 1 && s.t_s < t + 1.2;
    simulator.set(set);
    return Done{};
  }));
  // The feed of 10 mm/s is reached, and left, at 1 m/s2: in 10 ms.
  const double behind = 0.5 * 0.8 + 1 * 0.2;
  CHECK_NEAR(samples.back().t_s, plan.end_s + behind, 2 * kPeriod);
  CHECK_NEAR(simulator.program_s(), plan.end_s, 2 * kPeriod);
  const double way = feed * (plan.stop_s - plan.feed_s);  // what the first ramp lacks the last adds
  CHECK_NEAR(samples.back().feed_reference_m - samples.front().feed_reference_m, way, 1e-6);
  const auto velocity = [](const MachineSample& s) { return s.x->velocity; };
  CHECK_NEAR(mean(samples, t + 0.8, t + 1, velocity), 0.5 * feed, 0.01 * feed);
  CHECK_NEAR(mean(samples, t + 1.15, t + 1.2, velocity), 0, 0.01 * feed);
  CHECK_NEAR(mean(samples, t + 1.9, t + 2.1, velocity), feed, 0.01 * feed);
  // Less feed at a slower spindle: 0.5 / 0.8 of the chip.
  const auto torque = [](const MachineSample& s) { return s.cut.torque_Nm; };
  CHECK_NEAR(mean(samples, t + 0.8, t + 1, torque), 0.625 * kTorque_Nm, 0.01 * kTorque_Nm);
  const auto speed = [](const MachineSample& s) { return s.spindle->velocity; };
  CHECK_NEAR(mean(samples, t + 0.8, t + 1, speed), 0.8 * kTwoPi * 50, 0.5);
  CHECK_NEAR(mean(samples, t + 0.3, t + 0.5, speed), kTwoPi * 50, 0.5);
}

// The speed ramps in the cut, by 20 % a second, and the feed goes along.
void speed_ramp() {
  MachineSimulation m = machine();
  m.milling.workpiece = {};
  m.milling.speed = SpindleSpeedProfile::ramp(3000, 2400, 20, 3000);
  m.program.cut_s = 2.5;
  const auto samples = record(m);
  const CutSchedule plan = ready(m).schedule();
  for (const double t : {0.3, 0.8, 1.5, 2.4}) {
    const double rpm = std::max(2400.0, 3000 - 600 * t);
    const auto near_t = [&](auto value) {
      return mean(samples, plan.contact_s + t - 0.05, plan.contact_s + t + 0.05, value);
    };
    const double w = rad_s_from_rpm(rpm);
    CHECK_NEAR(near_t([](auto& s) { return s.spindle_reference_rad_s; }), w, 0.01);
    // The tool opens the slot meanwhile: the spindle answers torque that grows at 2 Nm/s with
    // growth / (K gain integral), 0.1 rad/s.
    CHECK_NEAR(near_t([](auto& s) { return s.spindle->velocity; }), w, 0.25);
    // The axis lags by 25 ms.
    const double then = rad_s_from_rpm(std::max(2400.0, 3000 - 600 * (t - 0.025)));
    CHECK_NEAR(near_t([](auto& s) { return s.x->velocity; }), then / kTwoPi * 4 * 50e-6, 2e-5);
  }
  CHECK_NEAR(mean(samples, plan.stop_s - 0.5, plan.stop_s, [](auto& s) { return s.cut.torque_Nm; }),
             kTorque_Nm, 1e-2 * kTorque_Nm);
}

// A tooth breaks 1.5 s after contact: from then on, and not before, a revolution is not four times
// the same.
void tooth_break() {
  MachineSimulation m = machine();
  m.milling.workpiece = {};
  m.milling.breaks = {{1.5, 3, 1}};
  m.program.cut_s = 2;
  const auto samples = record(m);
  const CutSchedule plan = ready(m).schedule();
  double first = kNone;
  for (std::size_t i = 40; i < samples.size(); ++i)
    if (samples[i].t_s > plan.contact_s + 1.2 &&
        std::abs(samples[i].cut.fy_N - samples[i - 40].cut.fy_N) > 0.1 * kForce_N)
      first = std::min(first, samples[i].t_s);
  CHECK_BETWEEN(first, plan.contact_s + 1.5, plan.contact_s + 1.521);
}

// x is pressed against a spring before it comes to the work: force in equilibrium, energy, and the
// spring that breaks.
void obstacle() {
  MachineSimulation m = machine();
  m.milling.clearance_m = 20e-3;  // from -30 mm
  m.x->drive.coulomb = 0;
  m.program.cut_s = 0.01;
  m.program.dwell_s = 0.5;
  m.obstacle = FeedObstacle{-15e-3, 2e5};
  const auto samples = record(m);
  const MachineSample& end = samples.back();
  const double depth = end.feed_reference_m + 15e-3;
  CHECK_BETWEEN(depth, 5e-3, 6e-3);
  CHECK_NEAR(end.obstacle_N, 2e5 * depth, 1e-6 * 2e5 * depth);
  CHECK_NEAR(end.x->current_A * 314, 2e5 * depth, 1e-6 * 2e5 * depth);
  double work = 0;
  for (std::size_t i = 1; i < samples.size(); ++i)
    work += samples[i].obstacle_N * (samples[i].x->position - samples[i - 1].x->position);
  CHECK_NEAR(work, 2e5 / 2 * depth * depth, 1e-4 * 2e5 / 2 * depth * depth);

  m.obstacle->strength_N = 500;
  MachineSimulator simulator = ready(m);
  double most = 0;
  int after = 0, breaks = 0;
  double last = 0;
  (void)good(simulator.run([&](const MachineSample& s) -> Expected<Done> {
    most = std::max(most, s.obstacle_N);
    if (last > 0 && s.obstacle_N == 0) ++breaks;
    if (breaks > 0 && s.obstacle_N > 0) ++after;
    last = s.obstacle_N;
    return Done{};
  }));
  // It grows by stiffness times feed, 0.25 N a period.
  CHECK_BETWEEN(most, 499, 500);
  CHECK(simulator.obstacle_broken() && breaks == 1 && after == 0);
}

// Behind a spring the cut follows the load: in the mean the spring is wound up by the torque.
void flexible_spindle() {
  MachineSimulation m = machine();
  m.milling.workpiece = {};
  m.program.cut_s = 2;
  m.program.dwell_s = 0.4;
  m.milling.step_s = 12.5e-6;  // ends with the period
  DriveModelConfig& drive = m.spindle->drive;
  drive.viscous = drive.coulomb = 0;
  EffectSetting coupling;
  coupling.effect = drive_effect_index("flexible-coupling");
  const double resonance_hz = 150, damping = 0.05, share = 0.3;
  std::size_t i = 0;
  for (const double value : {resonance_hz, damping, share}) {
    coupling.parameters[i].value[0] = value;
    coupling.parameters[i++].count = 1;
  }
  drive.effects.settings[drive.effects.count++] = coupling;
  const auto samples = record(m);
  const double end = ready(m).schedule().stop_s;
  const auto at_end = [&](auto value) { return mean(samples, end - 0.4, end, value); };
  const double w = kTwoPi * resonance_hz;
  const double stiffness = 0.0048 * share * (1 - share) * w * w;
  CHECK_NEAR(at_end([](auto& s) { return s.spindle->position - s.spindle->load_position; }),
             kTorque_Nm / stiffness, 2e-3 * kTorque_Nm / stiffness);
  CHECK_NEAR(at_end([](auto& s) { return s.spindle->current_A; }), kTorque_Nm / 0.5,
             2e-3 * kTorque_Nm / 0.5);
  // A tenth of the wind-up tells the load from the motor.
  CHECK_NEAR(at_end([](auto& s) { return s.cut.angle_rad - s.spindle->load_position; }), 0,
             0.1 * kTorque_Nm / stiffness);
}

// ---- Records.

void same_seed_same_bytes() {
  MachineSimulation m = machine();
  m.milling.workpiece.length_m = 2e-3;
  m.milling.structure.x = {{600, 0.03, 40}};
  add_sensors(*m.spindle, 131072, 0.02, 3);
  add_sensors(*m.x, 1048576, 0.05, 4);
  std::string one, two, other;
  const Trace trace = written(m, &one);
  (void)written(m, &two);
  m.spindle->seed = 5;
  (void)written(m, &other);
  CHECK(one == two);
  CHECK(one != other);
  const std::size_t header = one.find("t_s,");
  CHECK_TEXT(one.substr(header, one.find('\n', header) - header),
             "t_s,spindle.angle_counts,spindle.current_A,spindle.speed_rad_s,tool.torque_Nm,"
             "x.command_position_m,x.angle_counts,x.current_A,x.position_m,x.velocity_m_s,"
             "y.command_position_m,y.position_m,y.current_A,z.command_position_m,z.position_m,"
             "z.current_A,tool.force_x_N,tool.force_y_N,tool.displacement_x_m,"
             "tool.displacement_y_m");
  CHECK(trace.meta("contact_s").has_value());
  CHECK_NEAR(trace.sample_rate_hz(), 8000, 1e-6);
  // Counter: starts at 77, wraps at 2^24, follows the speed. Current: every fourth row.
  int wraps = 0;
  std::size_t news = 0;
  for (std::size_t i = 0; i < trace.size(); ++i) {
    if (i > 0 && trace.counts[0][i] < trace.counts[0][i - 1] - (1 << 23)) ++wraps;
    news += trace.updated[1][i];
  }
  CHECK(trace.counts[0][0] == 77);
  const auto& speed = *trace.find({Channel::spindle, Quantity::speed_rad_s});
  double turned = 0;
  for (const double w : speed) turned += w * kPeriod;
  CHECK(wraps == static_cast<int>(turned / kTwoPi / 128) && wraps >= 1);
  CHECK(news == (trace.size() + 3) / 4);

  MachineSimulation bare;
  bare.milling = slot();
  CHECK(record_signals(bare, false).size() == 2 && record_signals(bare, true).size() == 8);
}

void refusals() {
  const auto refused = [](const char* word, auto change) {
    MachineSimulation m = machine();
    change(m);
    const auto made = MachineSimulator::create(m);
    CHECK(!made);
    if (made) return;
    CHECK(made.error().kind == ErrorKind::usage);
    if (made.error().sentence.find(word) == std::string::npos)
      check::fail(__FILE__, __LINE__) << made.error().sentence << " (no " << word << ")\n";
  };
  using M = MachineSimulation;
  const double nan = std::nan("");
  refused("sample_period_s", [](M& m) { m.sample_period_s = 0; });
  refused("sample_period_s", [](M& m) { m.x->sample_period_s = 1e-3; });
  refused("servo period", [](M& m) { m.milling.step_s = 2e-4; });
  refused("spindle_acceleration", [](M& m) { m.program.spindle_acceleration_rad_s2 = 0; });
  refused("negative", [&](M& m) { m.program.spindle_acceleration_rad_s2 = nan; });
  refused("negative", [](M& m) { m.program.dwell_s = -1; });
  refused("both", [](M& m) { m.program.feed_jerk_m_s3 = 0; });
  refused("x drive", [](M& m) { m.program.feed_jerk_m_s3 = m.program.feed_acceleration_m_s2 = 0; });
  refused("clearance", [](M& m) { m.milling.clearance_m = 1e-6; });
  refused("cut_s", [](M& m) { m.milling.workpiece = {}; });
  refused("still in the work", [](M& m) { m.milling.workpiece.length_m = 1e3; });
  refused("profile", [](M& m) { m.milling.speed = {{{-1, 3000}, {1, 2000}}}; });
  refused("feed hold", [](M& m) { m.program.holds = {{-1, 1}}; });
  refused("feed hold", [](M& m) { m.program.holds = {{1, 1}, {1.5, 1}}; });
  refused("cut_s ends before", [](M& m) {
    m.program.holds = {{1, 1}};
    m.program.cut_s = 1.5;
  });
  refused("obstacle", [](M& m) { m.obstacle = FeedObstacle{0, 0}; });
  refused("too stiff", [](M& m) { m.obstacle = FeedObstacle{0, 1e10}; });
  refused("drive of x", [](M& m) {
    m.x.reset();
    m.obstacle = FeedObstacle{0, 1e5};
  });
  refused("teeth", [](M& m) { m.milling.tool.teeth = 0; });
  refused("spindle: drive simulator", [](M& m) { m.spindle->drive.inertia = 0; });
  refused("y: drive simulator", [](M& m) { m.y->effort_per_A = 0; });

  // A cut far beyond its limit ends the run, and says so.
  MachineSimulation m = machine();
  m.milling.structure.x = m.milling.structure.y = {{600, 0.01, 0.1}};
  m.milling.cut.axial_depth_m = 20e-3;
  m.milling.tool.force.tangential_coefficient_N_per_m2 = 1500e6;
  const auto run = ready(m).run();
  CHECK(!run && run.error().kind == ErrorKind::data);
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  ideal_drives_are_the_bare_cut();
  heavy_drives_are_the_bare_cut();
  static_equilibrium();
  spindle_droop();
  angle_lost_to_the_cut();
  energy_of_a_whole_slot();
  energy_of_random_cuts(2031, nightly ? 120 : 6);
  observers_get_the_cut_back();
  chatter_is_seen_in_the_drive();
  a_whole_record();
  feed_hold();
  overrides();
  speed_ramp();
  tooth_break();
  obstacle();
  flexible_spindle();
  same_seed_same_bytes();
  refusals();
  return check::done();
}
