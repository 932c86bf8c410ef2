// Thresholds of the monitors from an idling run: what the machine does by itself raises no alarm.
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "servosense/identify/alarm_rate.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/monitors/idle_statistics.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

/// Of a monitor that hears nothing but an idling machine: one in a hundred hours.
inline constexpr double kAcceptedAlarmsPerHour = 0.01;

/// Disturbance jerk of one axis [N/s]: of the whole run, and of each phase of motion. Noise is
/// heard in each phase, so the level that it leaves at the accepted rate (alarm_rate.hpp) is the
/// least threshold of all; it is learned where nothing else is heard, at rest and at constant
/// speed.
struct LearnedCollision : IdleStatistics {
  using IdleStatistics::IdleStatistics;
  /// A phase that lasted less than this in all is taken for unseen.
  static constexpr double kSeen_s = 0.1;

  /// Friction of the next run may be so much more or less (warm-up takes a multiple: Koike 2016,
  /// fig. 4-24). What its reversals then leave is worked out from the run itself.
  static constexpr double kFrictionVaries = 0.1;

  std::array<IdleStatistics, kMotionPhases> phase;
  std::array<double, kMotionPhases> other_friction{};  ///< held peaks with such a friction
  AlarmRate standing, moving;
  double sample_period_s = 0;
  double accepted_per_hour = kAcceptedAlarmsPerHour;

  /// Of the source's rule, what repeats (half as much again) and what noise leaves, the highest.
  // It knows more than the statistics alone, which nobody takes it for.
  // NOLINTNEXTLINE(bugprone-derived-method-shadowing-base-method)
  [[nodiscard]] double threshold() const;
  /// Never above that of the whole run, which an unseen phase gets: what the single threshold
  /// finds is found.
  [[nodiscard]] double phase_threshold(MotionPhase p) const;
  /// From noise, at the thresholds of the phases, the phases as often as in the run; not a number
  /// when the run is too short to say.
  [[nodiscard]] double alarms_per_hour() const;
};
/// `observer` and `collision` as planned for the stack, drive identified.
LearnedCollision learn_collision(const DisturbanceObserverConfig& observer,
                                 const CollisionConfig& collision, const DriveRecord& record,
                                 double accepted_per_hour = kAcceptedAlarmsPerHour);

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

/// Chatter power of the spindle [Nm2], once a revolution while it turns fast enough. A counter is
/// as loud as its lines at a speed make it, and these beat slowly: that repeats and is no noise. So
/// the power at the loudest speed, and above it what noise leaves at the accepted rate
/// (alarm_rate.hpp): what differs from the mean of the neighbours, in cube roots, in which the
/// power of noise is Gaussian (Wilson and Hilferty 1931).
struct LearnedChatter : IdleStatistics {
  using IdleStatistics::IdleStatistics;
  static constexpr double kSameSpeed = 0.02;     ///< relative
  static constexpr std::size_t kNeighbours = 8;  ///< revolutions to either side

  AlarmRate rate;           ///< of the roots above that mean
  double loudest_root = 0;  ///< highest mean
  double accepted_per_hour = kAcceptedAlarmsPerHour;

  /// Powers of revolutions in a row, at one speed.
  void add_stretch(const std::vector<double>& powers, double revolution_s);
  // It knows more than the statistics alone, which nobody takes it for.
  // NOLINTNEXTLINE(bugprone-derived-method-shadowing-base-method)
  [[nodiscard]] double threshold() const;
  /// What idling at the loudest speed raises at the threshold, where all of it counts, as in a cut;
  /// not a number when the run is too short to say.
  [[nodiscard]] double alarms_per_hour() const;
};
/// Forced vibration has no threshold that an idle run could teach: every cut is stronger. What is
/// tolerated in a cut besides grows with its load (ChatterConfig::tolerated_load_share).
LearnedChatter learn_chatter(const DisturbanceObserverConfig& observer,
                             const ChatterConfig& chatter, const DriveRecord& record,
                             double accepted_per_hour = kAcceptedAlarmsPerHour);

/// Noise of the idling torque as the breakage monitors hear it: of its mean over a tooth period,
/// and of a sample.
struct ToothNoise {
  IdleStatistics tooth;   ///< mean over a tooth period [Nm]
  IdleStatistics sample;  ///< [Nm]
};
ToothNoise learn_tooth_noise(const DisturbanceObserverConfig& observer, unsigned teeth,
                             const DriveRecord& record);

}  // namespace servosense
