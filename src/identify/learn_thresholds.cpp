#include "servosense/identify/learn_thresholds.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "servosense/dsp/angle_sampler.hpp"

namespace servosense {

LearnedCollision learn_collision(const DisturbanceObserverConfig& observer,
                                 const CollisionConfig& collision, const DriveRecord& record) {
  DisturbanceObserver<double> force;
  force.configure(observer);
  CollisionConfig silent = collision;
  silent.threshold_N_per_s = 0;
  CollisionMonitor<double> monitor;
  monitor.configure(silent);
  LearnedCollision learned(collision.consecutive_samples);
  learned.phase.fill(IdleStatistics(collision.consecutive_samples));
  learned.sample_period_s = collision.sample_period_s;
  for (const DriveSample<double>& sample : record.samples) {
    const double f = force.process(sample);
    monitor.process(f, force.state().quality, sample.increment);
    if (monitor.state().signal != SignalState::good) continue;
    const double jerk = monitor.state().jerk_N_per_s;
    learned.add(jerk);
    if (monitor.phase() != MotionPhase::unknown)
      learned.phase[static_cast<std::size_t>(monitor.phase())].add(jerk);
  }
  return learned;
}

double learn_cutting_torque(const DisturbanceObserverConfig& observer, const CutDetectorConfig& cut,
                            const DriveRecord& record) {
  DisturbanceObserver<double> torque;
  torque.configure(observer);
  CutDetectorConfig any = cut;
  any.torque_Nm = 1;  // it listens only when there is a level
  CutDetector<double> detector;
  detector.configure(any);
  // Nothing is cut while the speed changes, and what the inertia is off by then, or a current
  // without a sign, would hide every cut. So a stretch at one speed counts without its first ten
  // time constants, in which the filter forgets, and its last five, in which a change begins.
  constexpr double kSteady = 0.02;
  const double constant = 1 / (cut.cutoff_rad_s * record.sample_period_s);
  std::vector<double> stretch;  // highest of each time constant
  double highest = 0, highest_steady = 0, speed = 0, samples = 0;
  const auto end_stretch = [&] {
    for (std::size_t i = 10; i + 5 < stretch.size(); ++i)
      highest_steady = std::max(highest_steady, stretch[i]);
    stretch.clear();
    samples = 0;
  };
  for (const DriveSample<double>& sample : record.samples) {
    const double t = torque.process(sample);
    detector.process(t, sample.increment, torque.state().quality);
    const double now = detector.state().increment_rad;
    const double heard = std::abs(detector.state().torque_Nm);
    highest = std::max(highest, heard);
    const bool turns = std::abs(now) > cut.minimum_speed_rad_s * cut.sample_period_s;
    if (!turns || std::abs(now - speed) > kSteady * std::abs(speed)) {
      end_stretch();
      speed = now;
    }
    if (samples >= constant * static_cast<double>(stretch.size())) stretch.push_back(0);
    stretch.back() = std::max(stretch.back(), heard);
    ++samples;
  }
  end_stretch();
  return 1.5 * (highest_steady > 0 ? highest_steady : highest);
}

CutLearner::CutLearner(const HostStackConfig& config)
    : config_(config), stack_(std::make_unique<HostStack>()) {
  stack_->configure(config);
  for (std::size_t i = 0; i < kAxes; ++i)
    jerk_[i] = IdleStatistics(config.axis[i].collision.consecutive_samples);
}

void CutLearner::add(const ServoSample<double>& sample) {
  stack_->process(sample);
  const CutPresence cut = stack_->cut().state().cut;
  if (cut == CutPresence::air) return;
  if (cut == CutPresence::cutting) cutting_s_ += config_.cut.sample_period_s;
  for (std::size_t i = 0; i < kAxes; ++i) {
    const CollisionConfig& c = config_.axis[i].collision;
    const auto& state = stack_->collision(i).state();
    if (!config_.axis[i].present || state.signal != SignalState::good) continue;
    // A rapid is held against the thresholds of the air.
    const double travel = std::abs(stack_->axis(i).sample.increment);
    if (travel > c.maximum_feed_m_s * c.sample_period_s) continue;
    jerk_[i].add(state.jerk_N_per_s - c.mean_N_per_s);
  }
}

double CutLearner::threshold(std::size_t axis) const {
  return std::max(kMargin * highest(axis), config_.axis[axis].collision.threshold_N_per_s);
}

LearnedChatter learn_chatter(const DisturbanceObserverConfig& observer,
                             const ChatterConfig& chatter, const DriveRecord& record) {
  DisturbanceObserver<double> torque;
  torque.configure(observer);
  ChatterConfig silent = chatter;
  silent.chatter_threshold_Nm2 = silent.forced_threshold_Nm2 = 0;
  silent.cutting_torque_Nm = 0;  // all that is heard counts
  auto monitor = std::make_unique<HostStack::Chatter>();
  monitor->configure(silent);
  LearnedChatter learned(chatter.consecutive_revolutions);
  std::uint64_t verdicts = 0;
  double fastest = 0;
  for (const DriveSample<double>& sample : record.samples) {
    const double t = torque.process(sample);
    monitor->process(t, sample.turn_angle_rad, sample.increment, torque.state().quality);
    const auto& state = monitor->state();
    if (state.verdicts == verdicts) continue;
    verdicts = state.verdicts;
    if (state.signal != SignalState::good) continue;
    learned.add(state.chatter_Nm2);
    fastest = std::max(fastest, monitor->window().speed_rad_s);
  }
  learned.verdicts_per_hour = 3600 * fastest / kTwoPi;
  return learned;
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
