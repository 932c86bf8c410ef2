// Axes drawn at random, and what simulated drives record along a trajectory.
#pragma once

#include <cmath>
#include <cstdlib>
#include <random>

#include "check.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/reconcile/drive.hpp"
#include "servosense/sim/drive_simulator.hpp"
#include "servosense/sim/trajectory.hpp"

namespace random_axis {

using namespace servosense;

constexpr double kPeriod = 5e-4;

/// Log-uniform draws.
struct Between {
  std::mt19937_64 random;
  double operator()(double low, double high) {
    return low * std::pow(high / low, std::uniform_real_distribution<double>(0, 1)(random));
  }
};

/// Two laps of moves at several speeds, slow and fast, and small swings.
inline Trajectory moves() {
  Trajectory t;
  for (int lap = 0; lap < 2; ++lap) {
    (void)t.move_to(0.20, {0.25, 3, 60});
    (void)t.move_to(0.09, {0.02, 1, 30});
    (void)t.move_to(0.05, {0.10, 2, 40});
    (void)t.sine(0.003, 3, 6);
    (void)t.move_to(0.25, {0.40, 5, 100});
    (void)t.move_to(0.0, {0.30, 4, 80});
  }
  return t;
}

inline DriveSimulatorConfig draw(Between& between, unsigned seed) {
  DriveSimulatorConfig c;
  c.sample_period_s = kPeriod;
  c.drive.inertia = between(90, 240);
  c.drive.viscous = between(300, 1500);
  c.drive.coulomb = between(30, 150);
  c.drive.unit_per_turn = between(0.005, 0.02);
  c.effort_per_A = 200;
  const double loop_hz = between(20, 35);
  c.controller.position_gain_per_s = loop_hz;
  c.controller.velocity_gain_A_s = c.drive.inertia * 6.28 * loop_hz / c.effort_per_A;
  c.controller.velocity_integral_per_s = 0.3 * 6.28 * loop_hz;
  c.encoder.counts_per_turn = std::round(c.drive.unit_per_turn / between(5e-8, 2e-7));
  c.encoder.initial_counts = 1 << 20;
  c.current_noise_A = between(0.3, 2) / c.effort_per_A;
  c.seed = seed;
  return c;
}

/// What `machine` records, with the model that stands in the machine file.
inline reconcile::DriveData record(const DriveSimulatorConfig& machine,
                                   const DriveModelConfig& file, const Trajectory& motion,
                                   Channel channel = Channel::x) {
  auto simulator = DriveSimulator::create(machine);
  if (!simulator) {
    check::fail(__FILE__, __LINE__) << simulator.error().sentence << '\n';
    std::exit(1);
  }
  reconcile::DriveData data;
  data.channel = channel;
  data.sample_period_s = data.servo_period_s = machine.sample_period_s;
  data.model = data.observer.drive = file;
  data.model.effort_per_ampere = data.observer.drive.effort_per_ampere = machine.effort_per_A;
  DriveInputConfig input;
  input.sample_period_s = machine.sample_period_s;
  input.unit_per_count = data.unit_per_count =
      machine.drive.unit_per_turn / machine.encoder.counts_per_turn;
  input.unit_per_turn = machine.drive.unit_per_turn;
  input.effort_per_unit = data.effort_per_unit = machine.effort_per_A;
  DriveInput<double> conditioner;
  conditioner.configure(input);
  for (const DriveSimSample& s :
       simulator->run(motion.duration_s(), [&](double at) { return motion.at(at).position; })) {
    RawDriveSample<double> raw;
    raw.counts = s.angle_counts;
    raw.effort = s.current_A;
    data.samples.push_back(conditioner.process(raw));
  }
  return data;
}

}  // namespace random_axis
