// Thresholds of the monitors from an idling run: what the machine does by itself raises no alarm.
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <vector>

#include "servosense/identify/alarm_rate.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/monitors/idle_statistics.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

/// Of a monitor that hears nothing but an idling machine: one in a hundred hours.
inline constexpr double kAcceptedAlarmsPerHour = 0.01;

/// Disturbance jerk of one axis [N/s, where it turns Nm/s]: of the whole run, and of each phase of
/// motion. Noise is heard in each phase, so the level that it leaves at the phase's share of the
/// accepted rate (alarm_rate.hpp) is the least threshold; it is learned where nothing else is
/// heard, at rest and at constant speed. Where friction turns round or masses accelerate, each stay
/// in the phase has a peak, of motion and noise together. The next stay may go beyond the highest
/// peak by what stays differ that are most alike (that come from and go to the nearest speeds): the
/// tail of these differences counts besides, the wider the fewer there are. Moves that the run does
/// not repeat are not alike.
struct LearnedCollision : IdleStatistics {
  using IdleStatistics::IdleStatistics;
  /// A phase that lasted less than this in all, or came less than PeakTail::kLeast times, is taken
  /// for unseen.
  static constexpr double kSeen_s = 0.1;
  /// Friction of the next run may be so much more or less (warm-up takes a multiple: Koike 2016,
  /// fig. 4-24). What its reversals then leave is worked out from the run itself.
  static constexpr double kFrictionVaries = 0.1;
  /// A few stays that differ ask for a threshold beyond any contact. It is no more than so many
  /// times the highest peak, twice the margin of what repeats; the rate that this bears is said.
  static constexpr double kMostOverPeak = 3;

  /// From one phase of motion to the next.
  struct Stay {
    MotionPhase phase = MotionPhase::unknown;
    bool whole = false;       ///< it ended with another phase, not with the record or a fault
    double peak_N_per_s = 0;  ///< highest that was held, with the least favourable friction
    double from_m_s = 0, to_m_s = 0;  ///< speed a little before and after
  };

  std::array<IdleStatistics, kMotionPhases> phase;
  std::vector<Stay> stays;
  AlarmRate standing, moving;
  double sample_period_s = 0;
  double accepted_per_hour = kAcceptedAlarmsPerHour;

  /// Of the phases and of the source's rule, the highest.
  // It knows more than the statistics alone, which nobody takes it for.
  // NOLINTNEXTLINE(bugprone-derived-method-shadowing-base-method)
  [[nodiscard]] double threshold() const;
  /// Of the source's rule, what repeats (half as much again), what noise leaves and what peaks
  /// leave, the highest. An unseen phase gets that of the run.
  [[nodiscard]] double phase_threshold(MotionPhase p) const;
  /// From noise and peaks together, at the thresholds of the phases, the phases as often as in the
  /// run; not a number when the run is too short to say.
  [[nodiscard]] double alarms_per_hour() const;
  /// What the run lacks for the accepted rate, words for a sentence; empty when nothing.
  [[nodiscard]] std::string shortage() const;

 private:
  /// Where peaks count: at constant speed friction does what it did, and noise is all there is.
  struct Peaks {
    std::vector<double> each;  ///< of whole stays
    double highest = 0;        ///< of all
    PeakTail beyond;           ///< of what stays differ

    /// The next stay is like any of these, and differs from it to either side.
    [[nodiscard]] double per_hour(double level, double times = 1) const;
    [[nodiscard]] double level(double accepted) const;
  };
  [[nodiscard]] bool seen(MotionPhase p) const;
  [[nodiscard]] double hours() const;
  [[nodiscard]] Peaks peaks(MotionPhase p) const;
  [[nodiscard]] const AlarmRate& noise(MotionPhase p) const;
  [[nodiscard]] double noise_level(MotionPhase p) const;
  [[nodiscard]] double own_threshold(MotionPhase p) const;
  [[nodiscard]] double phase_alarms_per_hour(MotionPhase p) const;
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
  template <std::size_t Axes>
  void add(const ServoSample<double, Axes>& sample) {
    stack_->process(sample);
    learn();
  }

  /// For CollisionConfig::cutting_threshold_N_per_s of an axis; never below what it has in the air.
  [[nodiscard]] double threshold(std::size_t axis) const;
  /// Highest that was held for as many samples as an alarm takes.
  [[nodiscard]] double highest(std::size_t axis) const { return jerk_[axis].held_peak(); }
  [[nodiscard]] const HostStack& stack() const { return *stack_; }
  /// That the spindle has shown a cut, in all parts [s].
  [[nodiscard]] double cutting_s() const { return cutting_s_; }

 private:
  void learn();

  HostStackConfig config_;
  std::unique_ptr<HostStack> stack_;
  std::array<IdleStatistics, kAllAxes> jerk_;
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
