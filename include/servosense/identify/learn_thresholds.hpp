// Thresholds of the monitors from an idling run: what the machine does by itself raises no alarm.
#pragma once

#include <algorithm>
#include <array>
#include <memory>

#include "servosense/identify/idle.hpp"
#include "servosense/monitors/idle_statistics.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

/// Disturbance jerk of one axis [N/s]: of the whole run, and of each phase of motion.
struct LearnedCollision : IdleStatistics {
  using IdleStatistics::IdleStatistics;
  /// A phase that lasted less than this in all is taken for unseen.
  static constexpr double kSeen_s = 0.1;

  std::array<IdleStatistics, kMotionPhases> phase;
  double sample_period_s = 0;
  /// Never above that of the whole run, which an unseen phase gets: what the single threshold
  /// finds is found.
  [[nodiscard]] double phase_threshold(MotionPhase p) const noexcept {
    const IdleStatistics& seen = phase[static_cast<std::size_t>(p)];
    return static_cast<double>(seen.count()) * sample_period_s < kSeen_s
               ? threshold()
               : std::min(seen.threshold(), threshold());
  }
};
/// `observer` and `collision` as planned for the stack, drive identified.
LearnedCollision learn_collision(const DisturbanceObserverConfig& observer,
                                 const CollisionConfig& collision, const DriveRecord& record);

/// Low-passed torque of an idling spindle [Nm] at steady speed (at any, where there is none that
/// lasts 0.6 s), half as much again as it reaches: what is above it is a cut (CutDetector). 0 when
/// the record holds no usable sample.
double learn_cutting_torque(const DisturbanceObserverConfig& observer, const CutDetectorConfig& cut,
                            const DriveRecord& record);

/// Disturbance jerk [N/s] of the axes in recorded sound parts, where the tool cuts or might. One
/// part after the other: start(), then every sample of it.
class CutLearner {
 public:
  /// A tooth with a run-out of a tenth of the feed takes chips up to a fifth thicker, depths differ
  /// by a tenth, and the half again that IdleStatistics allows: 1.2 * 1.1 * 1.5.
  static constexpr double kMargin = 2;

  /// `config` as planned for the stack, cutting torque known.
  explicit CutLearner(const HostStackConfig& config);
  /// A new part begins.
  void start() { stack_->reset(); }
  void add(const ServoSample<double>& sample);

  /// For CollisionConfig::cutting_threshold_N_per_s of an axis; never below what it has in the air.
  [[nodiscard]] double threshold(std::size_t axis) const;
  /// Highest that was held for as many samples as an alarm takes.
  [[nodiscard]] double highest(std::size_t axis) const { return jerk_[axis].held_peak(); }
  [[nodiscard]] const HostStack& stack() const { return *stack_; }
  /// That the spindle has shown a cut, in all parts [s].
  [[nodiscard]] double cutting_s() const { return cutting_s_; }

 private:
  HostStackConfig config_;
  std::unique_ptr<HostStack> stack_;
  std::array<IdleStatistics, kAxes> jerk_;
  double cutting_s_ = 0;
};

/// Chatter power of the spindle [Nm2], once a revolution while it turns fast enough.
struct LearnedChatter : IdleStatistics {
  using IdleStatistics::IdleStatistics;
  double verdicts_per_hour = 0;  ///< at the fastest speed of the run
  /// Expected at the learned threshold while nothing is cut.
  [[nodiscard]] double false_alarms_per_hour() const noexcept {
    return verdicts_per_hour * exceedance(threshold());
  }
};
/// Forced vibration has no threshold that an idle run could teach: every cut is stronger. What is
/// tolerated in a cut besides grows with its load (ChatterConfig::tolerated_load_share).
LearnedChatter learn_chatter(const DisturbanceObserverConfig& observer,
                             const ChatterConfig& chatter, const DriveRecord& record);

/// Noise of the idling torque as the breakage monitors hear it: of its mean over a tooth period,
/// and of a sample.
struct ToothNoise {
  IdleStatistics tooth;   ///< mean over a tooth period [Nm]
  IdleStatistics sample;  ///< [Nm]
};
ToothNoise learn_tooth_noise(const DisturbanceObserverConfig& observer, unsigned teeth,
                             const DriveRecord& record);

}  // namespace servosense
