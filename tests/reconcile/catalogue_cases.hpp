// Every drive effect of the registry as it is hidden in simulated drives: on an axis and on a
// spindle. An effect that is not in the list fails the tests that read it.
#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "random_axis.hpp"
#include "servosense/core/units.hpp"

namespace catalogue {

using namespace servosense;

using Values = std::vector<std::vector<double>>;  // of one effect, in the order of its parameters

struct Case {
  const char* effect;
  Values axis;               // N, m
  Values spindle;            // Nm, rad
  const char* no_spindle{};  ///< why a spindle cannot have it
  const char* no_axis{};     ///< why an axis cannot
};

/// Sizes that are common; how large they are beside the noise is the noise's affair.
inline const std::vector<Case>& cases() {
  static const std::vector<Case> all = {
      {"viscous-friction", {{300}}, {{0.01}}},
      {"coulomb-friction", {{50}}, {{0.5}}},
      {"stribeck-friction", {{15}, {0.02}}, {{0.3}, {4}}},
      {"asymmetric-friction", {{60}, {4}}, {{0.004}, {0.1}}},
      {"presliding-hysteresis", {{4e5}, {30}}, {{15}, {0.3}}},
      {"quadratic-drag", {{300}}, {{8e-5}}},
      {"position-dependent-friction", {{0, 0, 0.25, 10}}, {{0, 0, 100, 0.3}}},
      {"thermal-friction-drift", {{20}, {10}}, {{0.3}, {10}}},
      {"constant-load", {{20}}, {{0.2}}},
      {"spring-load", {{200}, {0.1}}, {{0.005}, {40}}},
      {"torque-ripple", {{6}, {10}, {1}}, {{4}, {0.2}, {1}}},
      {"backlash", {{30e-6}}, {{0.02}}},
      {"flexible-coupling", {{45}, {0.05}, {0.4}, {0.6}}, {{45}, {0.05}, {0.3}}},
      {"transport-delay", {{3e-3}}, {{3e-3}}},
      {"current-loop-lag", {{50}}, {{50}}},
      {"encoder-eccentricity", {{3e-3}, {0.5}}, {{3e-3}, {0.5}}},
      {"lead-error", {{8e-6}, {1}, {2e-5}, {0.5}}, {}, "it has neither screw nor scale"},
      {"load-dependent-friction", {{0.1}}, {{0.1}}},
      {"thermal-viscous-drift", {{300}, {10}}, {{0.01}, {10}}},
      {"torque-saturation", {{1}, {0.3}}, {{3}, {0.3}}},
      {"field-weakening", {}, {{30}}, nullptr, "it is not run beyond base speed"},
  };
  return all;
}

inline const Case* find(const std::string& effect) {
  for (const Case& c : cases())
    if (effect == c.effect) return &c;
  return nullptr;
}

inline EffectSetting setting(const char* name, const Values& values) {
  EffectSetting s;
  s.effect = drive_effect_index(name);
  for (std::size_t p = 0; p < values.size(); ++p) {
    s.parameters[p].count = values[p].size();
    for (std::size_t k = 0; k < values[p].size(); ++k) s.parameters[p].value[k] = values[p][k];
  }
  return s;
}

/// A simulated drive, and what its owner believes of it.
struct Machine {
  DriveSimulatorConfig truth;
  DriveModelConfig known;
  Channel channel = Channel::x;
};

inline Machine axis(unsigned seed) {
  random_axis::Between between{std::mt19937_64(seed)};
  Machine m;
  m.truth = random_axis::draw(between, seed);
  DriveSimulatorConfig& c = m.truth;
  c.drive.friction_knee = std::max(5e-6, 4 * c.drive.unit_per_turn / c.encoder.counts_per_turn);
  m.known = c.drive;
  for (double* wrong : {&m.known.inertia, &m.known.viscous, &m.known.coulomb})
    *wrong *= between(1 / 1.1, 1.1);
  return m;
}

/// A spindle that turns both ways, its position held: 0.01 to 0.04 kg m2.
inline Machine spindle(unsigned seed) {
  random_axis::Between between{std::mt19937_64(seed)};
  Machine m;
  m.channel = Channel::spindle;
  DriveSimulatorConfig& c = m.truth;
  c.sample_period_s = random_axis::kPeriod;
  c.drive.inertia = between(0.01, 0.04);
  c.drive.viscous = between(0.005, 0.02);
  c.drive.coulomb = between(0.3, 1);
  c.drive.unit_per_turn = kTwoPi;
  c.drive.friction_knee = 1e-3;
  c.effort_per_A = 0.8;
  const double loop_hz = between(20, 35);
  c.controller.position_gain_per_s = loop_hz;
  c.controller.velocity_gain_A_s = c.drive.inertia * kTwoPi * loop_hz / c.effort_per_A;
  c.controller.velocity_integral_per_s = 0.3 * kTwoPi * loop_hz;
  c.encoder.counts_per_turn = 1 << 20;
  c.encoder.initial_counts = 1 << 18;
  c.current_noise_A = between(0.003, 0.02) / c.effort_per_A;
  c.seed = seed;
  m.known = c.drive;
  for (double* wrong : {&m.known.inertia, &m.known.viscous, &m.known.coulomb})
    *wrong *= between(1 / 1.1, 1.1);
  return m;
}

/// Laps of a program with several speeds, small reversals and sines, then another program.
inline Trajectory axis_motion(int laps = 1) {
  Trajectory t;
  for (int lap = 0; lap < laps; ++lap) {
    (void)t.move_to(0.20, {0.25, 3, 60});
    (void)t.dwell(0.2);
    (void)t.move_to(0.05, {0.10, 2, 40});
    (void)t.move_to(0.09, {0.02, 1, 30});
    (void)t.move_to(0.07, {0.02, 1, 30});
    (void)t.move_to(0.10, {0.40, 5, 100});
    (void)t.move_to(0.098, {0.002, 1, 30});
    (void)t.sine(0.0004, 2, 4);
    (void)t.sine(0.003, 3, 6);
    (void)t.move_to(0.25, {0.40, 4, 80});
    (void)t.move_to(0.0, {0.30, 4, 80});
    (void)t.dwell(0.2);
  }
  (void)t.move_to(0.15, {0.15, 3, 60});
  (void)t.move_to(0.10, {0.05, 2, 60});
  (void)t.sine(0.002, 2.5, 5);
  (void)t.move_to(0.22, {0.35, 4, 80});
  (void)t.move_to(0.02, {0.20, 4, 80});
  (void)t.move_to(0.04, {0.01, 1, 30});
  (void)t.move_to(0.0, {0.08, 1, 30});
  return t;
}

/// The same in kind: 2 to 80 rad/s over sixteen turns.
inline Trajectory spindle_motion(int laps = 1) {
  Trajectory t;
  for (int lap = 0; lap < laps; ++lap) {
    (void)t.move_to(80, {60, 500, 8000});
    (void)t.dwell(0.2);
    (void)t.move_to(20, {25, 400, 8000});
    (void)t.move_to(30, {5, 200, 6000});
    (void)t.move_to(25, {5, 200, 6000});
    (void)t.move_to(60, {80, 800, 16000});
    (void)t.move_to(58, {2, 100, 3000});
    (void)t.sine(0.2, 2, 4);
    (void)t.sine(1, 3, 6);
    (void)t.move_to(100, {80, 700, 12000});
    (void)t.move_to(0, {70, 700, 12000});
    (void)t.dwell(0.2);
  }
  (void)t.move_to(60, {35, 500, 8000});
  (void)t.move_to(40, {12, 400, 8000});
  (void)t.sine(0.7, 2.5, 5);
  (void)t.move_to(90, {75, 700, 12000});
  (void)t.move_to(10, {50, 700, 12000});
  (void)t.move_to(16, {3, 200, 6000});
  (void)t.move_to(0, {20, 200, 6000});
  return t;
}

/// Hides an effect; a term that every model has is taken out of this one instead.
inline void hide(Machine& m, const EffectSetting& effect) {
  m.truth.drive.effects.settings[m.truth.drive.effects.count++] = effect;
  const std::string name = kDriveEffects[effect.effect].name;
  if (name == "viscous-friction") m.truth.drive.viscous = m.known.viscous = 0;
  if (name == "coulomb-friction") m.truth.drive.coulomb = m.known.coulomb = 0;
}

/// What `m` records.
inline reconcile::DriveData record(const Machine& m, const Trajectory& motion) {
  return random_axis::record(m.truth, m.known, motion, m.channel);
}

}  // namespace catalogue
