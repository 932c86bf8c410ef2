// The cut between its drives: the ideal limit is the bare cut, the loads arrive where they should,
// the observers give back what was put in, and everything that is injected shows.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/stability_lobes.hpp"
#include "servosense/monitors/chatter.hpp"
#include "servosense/observer/disturbance_observer.hpp"
#include "servosense/observer/drive_config.hpp"
#include "servosense/sim/machining_simulator.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod_s = 125e-6;

// Koike 2016, tables 3-1 to 3-7; gains and torque constants are made up.
SpindleConfig spindle() {
  SpindleConfig c;
  c.torque_constant_Nm_per_A = 0.5;
  c.inertia_kg_m2 = 0.0048;
  c.viscous_friction_Nm_s_per_rad = 4.775e-4;
  c.coulomb_friction_Nm = 0.1062;
  c.encoder_counts_per_rev = 1048576;
  return c;
}
AxisConfig axis() {
  AxisConfig c;
  c.lead_m = 0.016;
  c.equivalent_mass_kg = 227;
  c.moving_mass_kg = 55;
  c.viscous_friction_N_s_per_m = 732;
  c.coulomb_friction_N = 94;
  c.torque_constant_Nm_per_A = 0.8;
  c.encoder_counts_per_rev = 1048576;
  return c;
}

DriveSimulatorConfig spindle_drive() {
  DriveSimulatorConfig c;
  c.drive = spindle().disturbance_observer(kPeriod_s, {}).drive;
  c.effort_per_A = 0.5;
  c.controller = {.velocity_gain_A_s = 2, .velocity_integral_per_s = 40};
  c.encoder.counts_per_turn = 1048576;
  return c;
}
DriveSimulatorConfig axis_drive() {
  DriveSimulatorConfig c;
  c.drive = axis().disturbance_observer(kPeriod_s, {}).drive;
  c.effort_per_A = axis().force_per_ampere();
  c.controller = {
      .position_gain_per_s = 40, .velocity_gain_A_s = 200, .velocity_integral_per_s = 60};
  c.encoder.counts_per_turn = 1048576;
  return c;
}

MachiningSimulation slot() {
  MachiningSimulation s;
  s.milling.tool.diameter_m = 0.016;
  s.milling.tool.teeth = 4;
  s.milling.tool.helix_deg = 30;
  s.milling.tool.force = {.tangential_coefficient_N_per_m2 = 8e8, .radial_ratio = 0.3};
  s.milling.cut = {6000, 8e-5, 2e-3, 0.016, MillingDirection::slot};
  s.milling.structure.x = s.milling.structure.y = {{900, 0.03, 0.5}};
  s.milling.layers = 4;
  s.milling.step_s = 12.5e-6;
  s.cut_s = 0.4;
  return s;
}

std::vector<MachiningSample> run(const MachiningSimulation& s) {
  auto simulator = MachiningSimulator::create(s);
  if (!simulator) check::fail(__FILE__, __LINE__) << simulator.error().sentence << '\n';
  if (!simulator) return {};
  auto samples = simulator->run();
  if (!samples) check::fail(__FILE__, __LINE__) << samples.error().sentence << '\n';
  return samples ? *samples : std::vector<MachiningSample>{};
}

/// With ideal drives the cut is the bare one, sample by sample.
void ideal_drives() {
  const MachiningSimulation s = slot();
  const auto samples = run(s);
  MillingSimulation bare = s.milling;
  bool started = false;
  std::vector<MillingStep> expected;
  double worst = 0, largest = 0;
  std::size_t at = 0;
  for (const MachiningSample& sample : samples) {
    if (sample.cutting && !started) {
      bare.start_angle_rad = std::fmod(sample.spindle.position, kTwoPi);
      auto cut = MillingSimulator::create(bare);
      CHECK(cut.has_value());
      if (!cut) return;
      auto steps = cut->run(s.cut_s, 8000);
      CHECK(steps.has_value());
      if (!steps) return;
      expected = *steps;
      started = true;
      continue;
    }
    if (!started || at == expected.size()) continue;
    worst = std::max(worst, std::abs(sample.cut.fx_N - expected[at].fx_N));
    largest = std::max(largest, std::abs(expected[at].fx_N));
    CHECK_NEAR(sample.cut.angle_rad, expected[at].angle_rad, 1e-8);
    ++at;
  }
  CHECK(at == expected.size() && at == 3200);
  CHECK(largest > 100);
  CHECK_NEAR(worst, 0, 1e-5 * largest);  // sums of increments round
}

/// Equilibrium and the way back through the observers.
void closed_loop() {
  MachiningSimulation s = slot();
  s.spindle = spindle_drive();
  s.x = axis_drive();
  s.y = axis_drive();
  auto simulator = MachiningSimulator::create(s);
  CHECK(simulator.has_value());
  if (!simulator) return;
  const auto samples = simulator->run();
  CHECK(samples.has_value());
  if (!samples) return;

  DisturbanceObserver<double> torque_observer, x_observer;
  torque_observer.configure(spindle().disturbance_observer(kPeriod_s, {500, 500}));
  x_observer.configure(axis().disturbance_observer(kPeriod_s, {335, 335}));
  DriveInput<double> spindle_input, x_input;
  const DriveSignal signal{MotionKind::counts, EffortKind::current_A};
  spindle_input.configure(spindle().input(signal, kPeriod_s));
  x_input.configure(axis().input(signal, kPeriod_s));

  // Whole revolutions of the settled cut: the second half of it.
  const double from = simulator->cut_from_s() + 0.2, to = from + 0.2;
  double torque = 0, seen_torque = 0, fx = 0, seen_fx = 0, speed = 0, effort = 0, count = 0;
  unsigned feeding = 0;
  for (const MachiningSample& sample : *samples) {
    const auto convert = [](const DriveSimSample& d) {
      RawDriveSample<double> raw;
      raw.counts = d.angle_counts;
      raw.effort = d.current_A;
      return raw;
    };
    const double t_hat = torque_observer.process(spindle_input.process(convert(sample.spindle)));
    const double f_hat = x_observer.process(x_input.process(convert(sample.x)));
    feeding += sample.x.velocity > 0.03;
    if (sample.t_s < from || sample.t_s >= to - kPeriod_s / 2) continue;
    torque += sample.cut.torque_Nm;
    fx += sample.cut.fx_N;
    seen_torque += t_hat;
    seen_fx += f_hat;
    speed += sample.spindle.velocity;
    effort += sample.spindle.effort;
    ++count;
  }
  CHECK_NEAR(count, 1600, 1);
  CHECK(feeding >= 3200);
  for (double* mean : {&torque, &fx, &seen_torque, &seen_fx, &speed, &effort}) *mean /= count;
  // Closed forms of the slot: the power per turn is Kt times the volume that is cut; the mean
  // feed force on the tool is -N a s (Kt pi/2 c ...) / 2 pi (Tarng 1988, App. B: mean of
  // -(cos + c sin) sin over the half turn).
  const double kt = 8e8, a = 2e-3, f = 8e-5, ratio = 0.3;
  CHECK_NEAR(torque, kt * a * f * 4 * 0.016 / kTwoPi, 0.01 * torque);
  CHECK_NEAR(fx, -kt * a * f * 4 / kTwoPi * ratio * kPi / 2, 0.01 * std::abs(fx));
  // The observer returns what the tool felt. Torque: 20 bits. Force on x: against the motion.
  CHECK_NEAR(seen_torque, torque, 0.01 * torque);
  CHECK_NEAR(seen_fx, -fx, 0.02 * std::abs(fx));
  // Integral action: no droop in the mean; the motor carries friction and cut.
  CHECK_NEAR(speed, rad_s_from_rpm(6000), 1e-3 * speed);
  CHECK_NEAR(effort, 0.1062 + 4.775e-4 * speed + torque, 0.005 * effort);
  check::figure("cutting torque put in", torque, "Nm");
  check::figure("seen by the observer", seen_torque, "Nm");
  check::figure("feed force put in", -fx, "N");
  check::figure("seen by the observer", seen_fx, "N");

  // At rest before and after.
  CHECK_NEAR(samples->front().spindle.velocity, 0, 0);
  CHECK_NEAR(samples->back().spindle.velocity, 0, 0.2);  // of 628; the integrator empties
  CHECK_NEAR(samples->back().x.velocity, 0, 1e-5);
}

/// Same seed, same bytes; noise is the only thing that the seed changes.
void deterministic() {
  MachiningSimulation s = slot();
  s.cut_s = 0.05;
  s.spindle = spindle_drive();
  s.spindle->current_noise_A = 0.02;
  const auto one = run(s), two = run(s);
  CHECK(one.size() == two.size() && !one.empty());
  bool same = true;
  for (std::size_t i = 0; i < std::min(one.size(), two.size()); ++i)
    same = same && one[i].spindle.current_A == two[i].spindle.current_A &&
           one[i].cut.torque_Nm == two[i].cut.torque_Nm &&
           one[i].spindle.angle_counts == two[i].spindle.angle_counts;
  CHECK(same);
  s.spindle->seed = 99;
  const auto other = run(s);
  CHECK(other.size() == one.size() && other[500].spindle.current_A != one[500].spindle.current_A);
}

/// Chatter in the drive's signals: beyond the limit depth it grows, below it does not.
double chatter_power(double axial_depth_m) {
  MachiningSimulation s = slot();
  s.milling.tool.helix_deg = 0;
  s.milling.layers = 1;
  s.milling.cut.axial_depth_m = axial_depth_m;
  s.spindle = spindle_drive();
  auto simulator = MachiningSimulator::create(s);
  if (!simulator) return std::nan("");
  DriveInput<double> input;
  DisturbanceObserver<double> observer;
  ChatterMonitor<double, 8, 10, 1024> monitor;
  ChatterConfig config;
  config.chatter_threshold_Nm2 = 1;
  monitor.configure(config);
  input.configure(spindle().input({MotionKind::counts, EffortKind::current_A}, kPeriod_s));
  observer.configure(spindle().disturbance_observer(kPeriod_s, {3500, 3500}));
  double power = 0;
  const auto done = simulator->run([&](const MachiningSample& sample) -> Expected<Done> {
    RawDriveSample<double> raw;
    raw.counts = sample.spindle.angle_counts;
    raw.effort = sample.spindle.current_A;
    const DriveSample<double> drive = input.process(raw);
    const double torque = observer.process(drive);
    monitor.process(torque, drive.turn_angle_rad, drive.increment, observer.state().quality);
    // Past the entry by more than the window.
    if (sample.t_s > simulator->cut_from_s() + 0.25 && sample.t_s < simulator->cut_to_s())
      power = std::max(power, static_cast<double>(monitor.state().chatter_Nm2));
    return Done{};
  });
  return done ? power : std::nan("");
}

void chatter() {
  const MillingSimulation m = slot().milling;
  const auto lobes = StabilityLobes::from_modes(m.structure, m.tool, m.cut);
  CHECK(lobes.has_value());
  if (!lobes) return;
  const double limit_m = lobes->limit_at(m.cut.spindle_speed_rpm).axial_depth_m;
  const double stable = chatter_power(0.6 * limit_m), unstable = chatter_power(2 * limit_m);
  check::figure("chatter power seen, stable cut", stable, "Nm2");
  check::figure("chatter power seen, chattering cut", unstable, "Nm2");
  CHECK(stable < 0.02);
  // Behind a 20-bit encoder; the observer passes a quarter of the amplitude at 950 Hz.
  CHECK(unstable > 5 * stable);
}

void events() {
  MachiningSimulation s = slot();
  s.spindle = spindle_drive();
  s.x = axis_drive();
  s.feed_holds = {{0.1, 0.1}};
  s.obstacles = {{Channel::x, 0.3, 2e7, 500}};
  s.milling.breaks = {{0.25, 1, 1}};
  auto simulator = MachiningSimulator::create(s);
  CHECK(simulator.has_value());
  if (!simulator) return;
  const auto samples = simulator->run();
  CHECK(samples.has_value());
  if (!samples) return;
  const double feed = 100 * 4 * 8e-5;
  double held = 1, contact = 0, after = 0, calm = 0;
  for (const MachiningSample& sample : *samples) {
    const double t = sample.t_s - simulator->cut_from_s();
    if (t > 0.19 && t < 0.2) held = std::min(held, std::abs(sample.x.velocity));
    const double beside = sample.x.cutting + sample.cut.fx_N;
    if (t > 0 && t < 0.29) calm = std::max(calm, std::abs(beside));
    if (t > 0.29 && t < 0.39) contact = std::max(contact, beside);
    if (t > 0.39 && t < 0.4) after = std::max(after, std::abs(beside));
  }
  CHECK(held < 0.05 * feed);
  CHECK_NEAR(calm, 0, 1e-9);
  // 20 N/um at 32 mm/s: 80 N a sample; it breaks at 500 N.
  CHECK_BETWEEN(contact, 420, 500);
  CHECK_NEAR(after, 0, 1e-9);
}

void refusals() {
  const auto refused = [](auto change, const std::string& part) {
    MachiningSimulation s = slot();
    s.spindle = spindle_drive();
    change(s);
    const auto made = MachiningSimulator::create(s);
    CHECK(!made);
    if (!made && made.error().sentence.find(part) == std::string::npos)
      CHECK_TEXT(made.error().sentence, part);
  };
  refused([](auto& s) { s.cut_s = 0; }, "cut_s");
  refused([](auto& s) { s.feed_acceleration_m_s2 = -1; }, "feed_acceleration_m_s2");
  refused([](auto& s) { s.milling.tool.teeth = 0; }, "teeth");
  refused([](auto& s) { s.spindle->drive.inertia = -1; }, "inertia");
  refused([](auto& s) { s.obstacles = {{Channel::spindle, 0, 1, 1}}; }, "obstacle");
  refused([](auto& s) { s.feed_holds = {{-1, 1}}; }, "feed hold");
  refused(
      [](auto& s) {
        s.milling.cut.radial_immersion_m = 1, s.milling.cut.direction = MillingDirection::up;
      },
      "immersion");
}

}  // namespace

int main() {
  ideal_drives();
  closed_loop();
  deterministic();
  chatter();
  events();
  refusals();
  return check::done();
}
