// Random milling machines, and what somebody with a hammer and a load meter believes of them: the
// truth times the errors that he states. The judge is an integration in time
// (oracles/regenerative_integration.hpp).
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <random>

#include "oracles/regenerative_integration.hpp"
#include "servosense/identify/recommended_cut.hpp"

namespace milling_machines {

using namespace servosense;

class Chance {
 public:
  explicit Chance(std::uint64_t seed) : random_(seed) {}
  double between(double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random_);
  }
  double by_ratio(double a, double b) { return std::exp(between(std::log(a), std::log(b))); }
  int whole(int a, int b) { return std::uniform_int_distribution<int>(a, b)(random_); }
  double normal() { return normal_(random_); }

 private:
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

struct Machine {
  Structure structure;
  MillingTool tool;
  MillingCut cut;
  CutLimits limits;
};

/// A 16 mm mill with four straight teeth, half immersed, climbing, in steel of 800 N/mm2.
inline Machine half_immersed(const Structure& structure, const CutLimits& limits) {
  Machine m;
  m.structure = structure;
  m.tool.diameter_m = 0.016;
  m.tool.teeth = 4;
  m.tool.force.tangential_coefficient_N_per_m2 = 8e8;
  m.tool.force.radial_ratio = 0.3;
  m.cut.direction = MillingDirection::down;
  m.cut.radial_immersion_m = 0.008;
  m.cut.feed_per_tooth_m = 1e-4;
  m.limits = limits;
  return m;
}

/// One or two modes a direction, 500 to 7500 Hz; two to five teeth, straight or helical; up, down
/// and slot; speeds over a ratio of three, the fastest near the first pocket.
inline Machine random_machine(Chance& chance, bool two_modes) {
  Machine m;
  const double first_hz = chance.by_ratio(500, 2500), stiffness = chance.by_ratio(3e6, 3e7);
  const auto mode = [&](double hz, double N_per_m) {
    return StructuralMode{hz, chance.by_ratio(0.01, 0.06), N_per_m / std::pow(kTwoPi * hz, 2)};
  };
  for (auto* modes : {&m.structure.x, &m.structure.y}) {
    modes->push_back(mode(first_hz * std::exp(0.08 * chance.normal()),
                          stiffness * std::exp(0.2 * chance.normal())));
    if (two_modes && chance.whole(0, 1) == 1)
      modes->push_back(mode(first_hz * chance.by_ratio(1.3, 3), stiffness * chance.by_ratio(1, 5)));
  }
  m.tool.diameter_m = chance.by_ratio(0.008, 0.025);
  m.tool.teeth = chance.whole(2, 5);
  m.tool.helix_deg = chance.whole(0, 2) == 0 ? 0 : chance.between(10, 40);
  m.tool.force.tangential_coefficient_N_per_m2 = chance.by_ratio(6e8, 2e9);
  m.tool.force.radial_ratio = chance.between(0.2, 0.5);
  const MillingDirection directions[] = {MillingDirection::up, MillingDirection::down,
                                         MillingDirection::slot};
  m.cut.direction = directions[chance.whole(0, 2)];
  m.cut.radial_immersion_m =
      m.tool.diameter_m *
      (m.cut.direction == MillingDirection::slot ? 1 : chance.by_ratio(0.1, 0.9));
  m.cut.feed_per_tooth_m = 1e-4;
  m.limits.greatest_rpm = 60 * first_hz / m.tool.teeth * chance.between(0.6, 1.15);
  m.limits.least_rpm = m.limits.greatest_rpm / 3;
  m.limits.feed_per_tooth_m = 1e-4;
  m.limits.axial_depth_m = 3 * m.tool.diameter_m;
  return m;
}

/// What is believed, with its stated errors: coefficient to 2 to 5 %, frequency to 0.1 to 0.3 %,
/// damping and mass to 2 to 6 %.
inline Machine believed(const Machine& truth, Chance& chance, CutErrors& errors) {
  Machine m = truth;
  errors = {};
  errors.tangential = chance.between(0.02, 0.05);
  errors.radial_ratio = chance.between(0.02, 0.07);
  errors.offset_m = 0;
  m.tool.force.tangential_coefficient_N_per_m2 *= std::exp(errors.tangential * chance.normal());
  m.tool.force.radial_ratio += errors.radial_ratio * chance.normal();
  m.tool.force.radial_ratio = std::max(0.0, m.tool.force.radial_ratio);
  for (const bool along_x : {true, false})
    for (StructuralMode& mode : along_x ? m.structure.x : m.structure.y) {
      const std::array<double, 3> e = {chance.by_ratio(0.001, 0.003), chance.by_ratio(0.02, 0.06),
                                       chance.by_ratio(0.02, 0.06)};
      mode.natural_frequency_hz *= std::exp(e[0] * chance.normal());
      mode.damping_ratio *= std::exp(e[1] * chance.normal());
      mode.modal_mass_kg *= std::exp(e[2] * chance.normal());
      (along_x ? errors.x : errors.y).push_back(e);
    }
  return m;
}

inline oracle::RegenerativeCut judged(const Structure& structure, const MillingTool& tool,
                                      const MillingCut& cut) {
  oracle::RegenerativeCut c;
  for (const bool along_x : {true, false})
    for (const StructuralMode& m : along_x ? structure.x : structure.y)
      c.modes.push_back({m.natural_frequency_hz, m.damping_ratio, m.modal_mass_kg, along_x});
  c.teeth = tool.teeth;
  c.diameter_m = tool.diameter_m;
  c.helix_rad = tool.helix_deg * kPi / 180;
  c.tangential_N_per_m2 = tool.force.tangential_coefficient_N_per_m2;
  c.radial_ratio = tool.force.radial_ratio;
  if (cut.direction != MillingDirection::slot) {
    const double swept = std::acos(1 - 2 * cut.radial_immersion_m / tool.diameter_m);
    c.start_rad = cut.direction == MillingDirection::up ? 0 : kPi - swept;
    c.exit_rad = c.start_rad + swept;
  }
  return c;
}

/// Limit depth near a guess, to 1 %; `deepest_m` where that is stable.
inline double limit_by_integration(const oracle::RegenerativeCut& c, double rpm, double deepest_m,
                                   double guess_m) {
  double low = 0, high = 0, depth = std::min(guess_m, deepest_m), factor = 1.15;
  while (low == 0 || high == 0) {
    if (oracle::growth_per_tooth(c, rpm, depth, 120, 20) < 0) {
      low = depth;
      if (depth >= deepest_m) return deepest_m;
      if (high == 0) depth = std::min(deepest_m, depth * factor);
    } else {
      high = depth;
      if (depth < 1e-7) return depth;
      if (low == 0) depth /= factor;
    }
    factor *= factor;
  }
  while (high - low > 0.01 * high) {
    const double middle = 0.5 * (low + high);
    (oracle::growth_per_tooth(c, rpm, middle, 120, 20) < 0 ? low : high) = middle;
  }
  return low;
}

/// Depth times speed of the best cut, over speeds 1.2 % apart.
inline double best_by_integration(const Machine& truth, double guess_m) {
  const oracle::RegenerativeCut c = judged(truth.structure, truth.tool, truth.cut);
  double best = 0;
  for (double rpm = truth.limits.least_rpm; rpm <= 1.0001 * truth.limits.greatest_rpm;
       rpm *= 1.012) {
    guess_m = std::max(1e-6, limit_by_integration(c, rpm, truth.limits.axial_depth_m, guess_m));
    best = std::max(best, guess_m * rpm);
  }
  return best;
}

}  // namespace milling_machines
