#include "servosense/identify/learn_thresholds.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "servosense/dsp/angle_sampler.hpp"

namespace servosense {

namespace {

/// Where noise is all that is heard; nullptr in the other phases.
AlarmRate* noise_of(LearnedCollision& learned, MotionPhase phase) {
  switch (phase) {
    case MotionPhase::standstill:
      return &learned.standing;
    case MotionPhase::constant_speed:
      return &learned.moving;
    default:
      return nullptr;
  }
}

/// Tells `hear(jerk, phase, phase before)` of every good sample.
template <typename Hear>
void listen(const DisturbanceObserverConfig& observer, const CollisionConfig& collision,
            const DriveRecord& record, Hear&& hear) {
  DisturbanceObserver<double> force;
  force.configure(observer);
  CollisionConfig silent = collision;
  silent.threshold_N_per_s = 0;
  CollisionMonitor<double> monitor;
  monitor.configure(silent);
  MotionPhase last = MotionPhase::unknown;
  for (const DriveSample<double>& sample : record.samples) {
    const double f = force.process(sample);
    monitor.process(f, force.state().quality, sample.increment);
    const bool good = monitor.state().signal == SignalState::good;
    const MotionPhase phase = good ? monitor.phase() : MotionPhase::unknown;
    if (good) hear(monitor.state().jerk_N_per_s, phase, last);
    last = phase;
  }
}

}  // namespace

double LearnedCollision::threshold() const {
  const double repeats = *std::max_element(other_friction.begin(), other_friction.end());
  return std::max({IdleStatistics::threshold(), kMargin * repeats,
                   standing.level(accepted_per_hour), moving.level(accepted_per_hour)});
}

double LearnedCollision::phase_threshold(MotionPhase p) const {
  const auto i = static_cast<std::size_t>(p);
  if (static_cast<double>(phase[i].count()) * sample_period_s < kSeen_s) return threshold();
  const AlarmRate& noise = p == MotionPhase::standstill ? standing : moving;
  return std::min(
      std::max({phase[i].threshold(), kMargin * other_friction[i], noise.level(accepted_per_hour)}),
      threshold());
}

double LearnedCollision::alarms_per_hour() const {
  double alarms = 0, hours = 0;
  for (const auto& [noise, p] : {std::pair{&standing, MotionPhase::standstill},
                                 std::pair{&moving, MotionPhase::constant_speed}}) {
    if (!noise->known()) continue;
    alarms += noise->hours() * noise->per_hour(phase_threshold(p));
    hours += noise->hours();
  }
  return hours > 0 ? alarms / hours : std::numeric_limits<double>::quiet_NaN();
}

LearnedCollision learn_collision(const DisturbanceObserverConfig& observer,
                                 const CollisionConfig& collision, const DriveRecord& record,
                                 double accepted_per_hour) {
  LearnedCollision learned(collision.consecutive_samples);
  learned.phase.fill(IdleStatistics(collision.consecutive_samples));
  learned.standing = learned.moving = AlarmRate(collision.consecutive_samples);
  learned.sample_period_s = collision.sample_period_s;
  learned.accepted_per_hour = accepted_per_hour;
  listen(observer, collision, record, [&](double jerk, MotionPhase phase, MotionPhase last) {
    if (phase != last)
      for (AlarmRate* noise : {&learned.standing, &learned.moving}) noise->interrupt();
    learned.add(jerk);
    if (phase != MotionPhase::unknown) learned.phase[static_cast<std::size_t>(phase)].add(jerk);
    if (AlarmRate* noise = noise_of(learned, phase)) noise->add(jerk, collision.sample_period_s);
  });
  for (const double share :
       {1 - LearnedCollision::kFrictionVaries, 1 + LearnedCollision::kFrictionVaries}) {
    if (!(observer.drive.coulomb > 0)) break;
    DisturbanceObserverConfig other = observer;
    other.drive.coulomb *= share;
    std::array<IdleStatistics, kMotionPhases> phase;
    phase.fill(IdleStatistics(collision.consecutive_samples));
    listen(other, collision, record, [&](double jerk, MotionPhase p, MotionPhase) {
      if (p != MotionPhase::unknown) phase[static_cast<std::size_t>(p)].add(jerk);
    });
    for (std::size_t p = 0; p < kMotionPhases; ++p)
      learned.other_friction[p] = std::max(learned.other_friction[p], phase[p].held_peak());
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

double LearnedChatter::threshold() const {
  const double root = loudest_root + rate.level(accepted_per_hour);
  return std::max(IdleStatistics::threshold(), rate.known() ? root * root * root : 0);
}

double LearnedChatter::alarms_per_hour() const {
  return rate.per_hour(std::cbrt(threshold()) - loudest_root);
}

void LearnedChatter::add_stretch(const std::vector<double>& powers, double revolution_s) {
  constexpr std::size_t kWhole = 2 * kNeighbours + 1;
  if (powers.size() < kWhole) return;
  std::vector<double> root;
  root.reserve(powers.size());
  for (const double p : powers) root.push_back(std::cbrt(p));
  for (std::size_t i = 0; i < root.size(); ++i) {
    const std::size_t from = std::min(i - std::min(i, kNeighbours), root.size() - kWhole);
    double mean = 0;
    for (std::size_t j = from; j < from + kWhole; ++j)
      mean += root[j] / static_cast<double>(kWhole);
    loudest_root = std::max(loudest_root, mean);
    rate.add(std::max(0.0, root[i] - mean), revolution_s);
  }
  rate.interrupt();
}

LearnedChatter learn_chatter(const DisturbanceObserverConfig& observer,
                             const ChatterConfig& chatter, const DriveRecord& record,
                             double accepted_per_hour) {
  DisturbanceObserver<double> torque;
  torque.configure(observer);
  ChatterConfig silent = chatter;
  silent.chatter_threshold_Nm2 = silent.forced_threshold_Nm2 = 0;
  silent.cutting_torque_Nm = 0;  // all that is heard counts
  auto monitor = std::make_unique<HostStack::Chatter>();
  monitor->configure(silent);
  LearnedChatter learned(chatter.consecutive_revolutions);
  learned.rate = AlarmRate(chatter.consecutive_revolutions);
  learned.accepted_per_hour = accepted_per_hour;
  std::vector<double> stretch;  // at one speed
  double speed = 0;
  const auto end_stretch = [&] {
    if (!stretch.empty()) learned.add_stretch(stretch, kTwoPi / speed);
    stretch.clear();
  };
  std::uint64_t verdicts = 0;
  for (const DriveSample<double>& sample : record.samples) {
    const double t = torque.process(sample);
    monitor->process(t, sample.turn_angle_rad, sample.increment, torque.state().quality);
    const auto& state = monitor->state();
    if (state.verdicts == verdicts) continue;
    verdicts = state.verdicts;
    if (state.signal != SignalState::good) {
      end_stretch();
      continue;
    }
    learned.add(state.chatter_Nm2);
    const double now = std::abs(monitor->window().speed_rad_s);
    if (std::abs(now - speed) > LearnedChatter::kSameSpeed * speed) {
      end_stretch();
      speed = now;
    }
    stretch.push_back(state.chatter_Nm2);
  }
  end_stretch();
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
