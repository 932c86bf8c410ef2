#include "servosense/identify/learn_thresholds.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "servosense/dsp/angle_sampler.hpp"

namespace servosense {

namespace {

constexpr std::array kPhases = {MotionPhase::standstill, MotionPhase::constant_speed,
                                MotionPhase::acceleration, MotionPhase::reversal};
/// Of the accepted rate, for a phase. Half of it where contacts are to be found first.
constexpr double share_of(MotionPhase p) {
  return p == MotionPhase::constant_speed ? 1.0 / 2 : 1.0 / 6;
}

/// Tells `hear(jerk, phase)` of every sample; the phase is unknown where the sample is not good.
template <typename Hear>
void listen(const DisturbanceObserverConfig& observer, const CollisionConfig& collision,
            const DriveRecord& record, Hear&& hear) {
  DisturbanceObserver<double> force;
  force.configure(observer);
  CollisionConfig silent = collision;
  silent.threshold_N_per_s = 0;
  CollisionMonitor<double> monitor;
  monitor.configure(silent);
  for (const DriveSample<double>& sample : record.samples) {
    const double f = force.process(sample);
    monitor.process(f, sample.increment, force.state().quality);
    const bool good = monitor.state().signal == SignalState::good;
    hear(good ? monitor.state().jerk_N_per_s : std::numeric_limits<double>::quiet_NaN(),
         good ? monitor.phase() : MotionPhase::unknown);
  }
}

/// Cuts what is heard into stays.
class Stays {
 public:
  Stays(const DriveRecord& record, unsigned consecutive)
      : consecutive_(consecutive), held_(consecutive), period_s_(record.sample_period_s) {
    double at = 0;
    for (const DriveSample<double>& s : record.samples) travel_.push_back(at += s.increment);
  }
  void hear(double jerk, MotionPhase phase) {
    if (phase != phase_) {
      end(phase != MotionPhase::unknown);
      begin_ = at_;
    }
    phase_ = phase;
    held_.add(jerk);
    ++at_;
  }
  std::vector<LearnedCollision::Stay> all() {
    end(false);
    return std::move(all_);
  }

 private:
  static constexpr double kOutside_s = 0.05;  // before and after
  static constexpr double kOver_s = 0.01;     // the speed is that over so long

  [[nodiscard]] double travel(double at) const {
    const auto last = static_cast<double>(travel_.size() - 1);
    return travel_[static_cast<std::size_t>(std::clamp(at, 0.0, last))];
  }
  [[nodiscard]] double speed(std::size_t at, double later_s) const {
    const double middle = static_cast<double>(at) + later_s / period_s_;
    const double half = std::max(1.0, 0.5 * kOver_s / period_s_);
    return (travel(middle + half) - travel(middle - half)) / (2 * half * period_s_);
  }
  void end(bool whole) {
    if (phase_ != MotionPhase::unknown)
      all_.push_back(
          {phase_, whole, held_.held_peak(), speed(begin_, -kOutside_s), speed(at_, kOutside_s)});
    held_ = IdleStatistics(consecutive_);
    phase_ = MotionPhase::unknown;
  }

  unsigned consecutive_;
  IdleStatistics held_;
  double period_s_;
  std::vector<double> travel_;
  std::size_t at_ = 0, begin_ = 0;
  MotionPhase phase_ = MotionPhase::unknown;
  std::vector<LearnedCollision::Stay> all_;
};

/// What each differs from the one that is most like it.
std::vector<double> differences(const std::vector<LearnedCollision::Stay>& stays) {
  std::vector<double> found;
  for (std::size_t i = 0; i < stays.size(); ++i) {
    double nearest = std::numeric_limits<double>::infinity(), difference = 0;
    for (std::size_t j = 0; j < stays.size(); ++j) {
      const double apart =
          std::hypot(stays[i].from_m_s - stays[j].from_m_s, stays[i].to_m_s - stays[j].to_m_s);
      if (j == i || !(apart < nearest)) continue;
      nearest = apart;
      difference = std::abs(stays[i].peak_N_per_s - stays[j].peak_N_per_s);
    }
    found.push_back(difference);
  }
  return found;
}

}  // namespace

bool LearnedCollision::seen(MotionPhase p) const {
  const IdleStatistics& all = phase[static_cast<std::size_t>(p)];
  const std::size_t times = peaks(p).each.size();  // 0: it never ended, or peaks do not count
  return static_cast<double>(all.count()) * sample_period_s >= kSeen_s &&
         (times == 0 || times >= PeakTail::kLeast);
}

double LearnedCollision::hours() const {
  return static_cast<double>(count()) * sample_period_s / 3600;
}

LearnedCollision::Peaks LearnedCollision::peaks(MotionPhase p) const {
  Peaks found;
  std::vector<Stay> whole;
  for (const Stay& stay : stays) {
    if (stay.phase != p) continue;
    found.highest = std::max(found.highest, stay.peak_N_per_s);
    if (!stay.whole || p == MotionPhase::constant_speed) continue;
    whole.push_back(stay);
    found.each.push_back(stay.peak_N_per_s);
  }
  found.beyond = PeakTail(differences(whole), 2, hours());
  return found;
}

double LearnedCollision::Peaks::per_hour(double level, double times) const {
  double sum = 0;
  for (const double peak : each) sum += beyond.per_hour(level - peak, times);
  return each.empty() ? 0 : sum / (2 * static_cast<double>(each.size()));
}

double LearnedCollision::Peaks::level(double accepted) const {
  double low = highest;
  double high = kMostOverPeak * highest;
  if (!(per_hour(high) <= accepted)) return high;  // or not known
  for (int i = 0; i < 50; ++i) {
    const double middle = (low + high) / 2;
    (per_hour(middle) <= accepted ? high : low) = middle;
  }
  return high;
}

const AlarmRate& LearnedCollision::noise(MotionPhase p) const {
  return p == MotionPhase::standstill ? standing : moving;
}

double LearnedCollision::noise_level(MotionPhase p) const {
  const AlarmRate& heard = noise(p);
  if (!heard.known()) return 0;
  const MotionPhase from = &heard == &moving ? MotionPhase::constant_speed : p;
  return heard.level(share_of(from) * accepted_per_hour * hours() / heard.hours());
}

double LearnedCollision::own_threshold(MotionPhase p) const {
  const Peaks heard = peaks(p);
  const double by_rule = std::max(
      {phase[static_cast<std::size_t>(p)].threshold(), kMargin * heard.highest, noise_level(p)});
  if (heard.each.empty()) return by_rule;
  return std::max(by_rule, heard.level(share_of(p) * accepted_per_hour));
}

double LearnedCollision::threshold() const {
  double highest = IdleStatistics::threshold();
  for (const MotionPhase p : kPhases) highest = std::max(highest, own_threshold(p));
  return highest;
}

double LearnedCollision::phase_threshold(MotionPhase p) const {
  return seen(p) ? own_threshold(p) : threshold();
}

double LearnedCollision::phase_alarms_per_hour(MotionPhase p) const {
  const double level = phase_threshold(p);
  const Peaks heard = peaks(p);
  const double by_peaks = heard.per_hour(level);
  if (p != MotionPhase::standstill && p != MotionPhase::constant_speed) return by_peaks;
  const double by_noise = noise(p).per_hour(level) * noise(p).hours() / hours();
  // Stays too short to tell their noise have peaks all the same.
  if (!heard.each.empty() && !noise(p).known()) return by_peaks;
  return std::max(by_peaks, by_noise);
}

double LearnedCollision::alarms_per_hour() const {
  double alarms = 0;
  bool any = false;
  for (const MotionPhase p : kPhases) {
    const bool told = seen(p);
    if (!told && peaks(p).each.empty()) continue;
    alarms += told ? phase_alarms_per_hour(p) : std::numeric_limits<double>::quiet_NaN();
    any = true;
  }
  return any ? alarms : std::numeric_limits<double>::quiet_NaN();
}

std::string LearnedCollision::shortage() const {
  if (alarms_per_hour() <= 1.001 * accepted_per_hour) return {};
  constexpr double kFewest = 4, kMost = 100;  // times that each move may have to come
  double times = 0;
  for (const MotionPhase p : kPhases) {
    const Peaks heard = peaks(p);
    const double accepted = share_of(p) * accepted_per_hour;
    const double at = own_threshold(p);
    if (heard.each.empty() || heard.per_hour(at) <= accepted) continue;
    double needed = kFewest;
    while (needed < kMost && heard.per_hour(at, needed) > accepted) ++needed;
    times = std::max(times, needed);
  }
  if (times == 0) return {};
  char words[200];
  std::snprintf(words, sizeof words,
                "starts, stops and reversals are too few, or too unlike each other, for the "
                "accepted rate of false alarms; let the record go through its moves %.0f times",
                times);
  return words;
}

LearnedCollision learn_collision(const DisturbanceObserverConfig& observer,
                                 const CollisionConfig& collision, const DriveRecord& record,
                                 double accepted_per_hour) {
  const unsigned consecutive = collision.consecutive_samples;
  LearnedCollision learned(consecutive);
  learned.phase.fill(IdleStatistics(consecutive));
  learned.standing = learned.moving = AlarmRate(consecutive);
  learned.sample_period_s = collision.sample_period_s;
  learned.accepted_per_hour = accepted_per_hour;
  Stays stays(record, consecutive);
  MotionPhase last = MotionPhase::unknown;
  listen(observer, collision, record, [&](double jerk, MotionPhase phase) {
    if (phase != last)
      for (AlarmRate* noise : {&learned.standing, &learned.moving}) noise->interrupt();
    last = phase;
    stays.hear(jerk, phase);
    learned.add(jerk);
    if (phase != MotionPhase::unknown) learned.phase[static_cast<std::size_t>(phase)].add(jerk);
    if (phase == MotionPhase::standstill) learned.standing.add(jerk, collision.sample_period_s);
    if (phase == MotionPhase::constant_speed) learned.moving.add(jerk, collision.sample_period_s);
  });
  learned.stays = stays.all();
  for (const double share :
       {1 - LearnedCollision::kFrictionVaries, 1 + LearnedCollision::kFrictionVaries}) {
    if (!(observer.drive.coulomb > 0)) break;
    DisturbanceObserverConfig other = observer;
    other.drive.coulomb *= share;
    Stays again(record, consecutive);
    listen(other, collision, record,
           [&](double jerk, MotionPhase phase) { again.hear(jerk, phase); });
    // The motion is the same, and so are the stays.
    const std::vector<LearnedCollision::Stay> with = again.all();
    for (std::size_t i = 0; i < learned.stays.size(); ++i)
      learned.stays[i].peak_N_per_s = std::max(learned.stays[i].peak_N_per_s, with[i].peak_N_per_s);
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
  for (std::size_t i = 0; i < kAllAxes; ++i)
    jerk_[i] = IdleStatistics(config.axis[i].collision.consecutive_samples);
}

void CutLearner::learn() {
  const auto& tool = stack_->cut().state();
  if (tool.cut == CutPresence::air || tool.assumed) return;
  if (tool.cut == CutPresence::cutting) cutting_s_ += config_.cut.sample_period_s;
  for (std::size_t i = 0; i < kAllAxes; ++i) {
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
