// The torque that the chatter monitor hears of a cut, that without noise, and the cut without
// vibration.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "detection/random_cuts.hpp"

namespace detection {

/// What the chatter monitor hears.
inline std::vector<double> heard(const Cut& c, const Record& r, const HostStackConfig& config) {
  static auto stack = std::make_unique<HostStack>();
  stack->configure(config);
  Reporter<double> reporter(c, r, c.seed + 1);
  std::vector<double> torque_Nm;
  for (std::size_t i = 0; i < r.size(); ++i) {
    stack->process(reporter.at(i));
    torque_Nm.push_back(stack->spindle().estimate);
  }
  return torque_Nm;
}

/// The same with a counter and a current without noise.
inline std::vector<double> heard_exactly(const Cut& c, const Record& r,
                                         const HostStackConfig& config) {
  DisturbanceObserver<double> observer;
  observer.configure(config.spindle.monitor_observer);
  const DriveRun& run = r.drive[0];
  const double constant = *c.machine.number("spindle", "torque_constant_Nm_per_A");
  std::vector<double> torque_Nm;
  DriveSample<double> s;
  s.position = run.position.empty() ? 0 : run.position[0];
  s.quality = Quality::restarted;
  for (std::size_t i = 0; i < r.size(); ++i) {
    s.increment = run.position[i] - s.position;
    s.position = run.position[i];
    if (run.is_new[i]) s.effort = constant * static_cast<double>(run.current_A[i]);
    torque_Nm.push_back(observer.process(s));
    s.quality = Quality::good;
  }
  return torque_Nm;
}

/// The cut with a structure ten thousand times as stiff: no vibration.
inline Cut rigid(Cut c) {
  auto& structure = c.simulation.milling.structure;
  for (auto* axis : {&structure.x, &structure.y})
    for (auto& mode : *axis) mode.modal_mass_kg *= 1e4;
  return c;
}

}  // namespace detection
