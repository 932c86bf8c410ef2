#include "servosense/identify/learn_thresholds.hpp"

#include <memory>

namespace servosense {

IdleStatistics learn_collision(const DisturbanceObserverConfig& observer,
                               const CollisionConfig& collision, const DriveRecord& record) {
  DisturbanceObserver<double> force;
  force.configure(observer);
  CollisionConfig silent = collision;
  silent.threshold_N_per_s = 0;
  CollisionMonitor<double> monitor;
  monitor.configure(silent);
  IdleStatistics statistics(collision.consecutive_samples);
  for (const DriveSample<double>& sample : record.samples) {
    const double f = force.process(sample);
    monitor.process(f, force.state().quality);
    if (monitor.state().signal == SignalState::good) statistics.add(monitor.state().jerk_N_per_s);
  }
  return statistics;
}

IdleStatistics learn_chatter(const DisturbanceObserverConfig& observer,
                             const ChatterConfig& chatter, const DriveRecord& record) {
  DisturbanceObserver<double> torque;
  torque.configure(observer);
  ChatterConfig silent = chatter;
  silent.chatter_threshold_Nm2 = silent.forced_threshold_Nm2 = 0;
  auto monitor = std::make_unique<HostStack::Chatter>();
  monitor->configure(silent);
  IdleStatistics statistics;
  for (const DriveSample<double>& sample : record.samples) {
    const double t = torque.process(sample);
    monitor->process(t, sample.turn_angle_rad, sample.increment, torque.state().quality);
    if (monitor->state().signal == SignalState::good) statistics.add(monitor->state().chatter_Nm2);
  }
  return statistics;
}

}  // namespace servosense
