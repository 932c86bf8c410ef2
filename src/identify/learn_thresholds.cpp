#include "servosense/identify/learn_thresholds.hpp"

#include <cmath>
#include <memory>

#include "servosense/dsp/angle_sampler.hpp"

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

ToothNoise learn_tooth_noise(const DisturbanceObserverConfig& observer, unsigned teeth,
                             const DriveRecord& record) {
  DisturbanceObserver<double> torque;
  torque.configure(observer);
  AngleSampler<double> sampler;
  sampler.configure({teeth, 0});
  // From this speed on friction and its sign are settled.
  const double fast = 50 * record.sample_period_s;
  ToothNoise noise;
  for (const DriveSample<double>& sample : record.samples) {
    const double t = torque.process(sample);
    const Quality quality = torque.state().quality;
    const bool complete = sampler.process(t, sample.turn_angle_rad, quality);
    if (std::abs(sample.increment) < fast ||
        has(quality, kUnusable | Quality::gap | Quality::settling))
      continue;
    noise.sample.add(t);
    if (complete) noise.tooth.add(sampler.state().part.mean[0]);
  }
  return noise;
}

}  // namespace servosense
