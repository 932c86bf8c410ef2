// Identification from an idling run: what the drive costs when nothing is cut.
//
// Purpose: nominal inertia, viscous and Coulomb friction and constant load such that the
// disturbance observer reads zero in the air (Koike 2016, section 3.2, which prints no procedure).
// Method: the observer is linear in these parameters, so its own response to each of them, one
// observer per parameter, is the regressor; least squares over the samples in motion then minimises
// exactly what the monitors will see. The travel over which Coulomb friction reverses (the knee) is
// searched on a grid. Effects already in the machine file are kept and subtracted. Standard errors
// allow for correlated residuals over 0.1 s (the larger of Newey and West 1987 and of what the
// autocovariance of the residual says), for friction that is no straight line over speed, for an
// effort that acts late and for noise of the encoder (docs/identify-idle.md).
// Bad at: records that move one way only, at one speed only or hardly accelerate; these are refused
// with what to record instead.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/io/power_reading.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

/// An idling run of one drive, conditioned by DriveInput.
struct DriveRecord {
  Channel channel = Channel::x;
  double sample_period_s = 0;
  std::vector<DriveSample<double>> samples;
  std::vector<double> temperature_C{};  ///< of the motor, one a sample; empty: not recorded
};

struct IdleOptions {
  /// Rate of false alarms that the detectability floor is stated for [1/h].
  double false_alarm_rate_per_hour = 0.01;
  /// Fit at no higher cutoff than this: above it, encoder noise biases the inertia.
  double highest_cutoff_rad_s = 500;
  /// Knees to try [m or rad], the first unless another fits better; empty keeps the one configured.
  std::vector<double> knees;
  /// Whether the torque constant may fall with speed: of a spindle, where the effort is a current.
  bool seek_field_weakening = false;
  /// Whether it may fall with current: where the effort is one.
  bool seek_saturation = false;
  /// Whether the effort is a power over the speed, so that its errors are those of the power.
  bool power = false;
  /// What is off it already of the losses that are sought in it: a constant and one in the square
  /// of the torque (identify/power_losses.hpp). Nothing: none are sought.
  std::optional<PowerLosses> losses{};
  /// Shortest record in motion that is accepted [s].
  double shortest_motion_s = 0.5;
};

struct Estimate {
  double value = 0;
  double standard_error = 0;
};

/// What the observer reads in the air once the drive is identified, at the observer's own cutoffs.
struct DetectabilityFloor {
  double noise_rms = 0;         ///< N or Nm, about the mean
  double noise_peak = 0;        ///< largest |estimate - mean|
  double crossing_rate_hz = 0;  ///< mean-level crossings a second, the noise's own bandwidth
  double threshold = 0;         ///< level that noise alone exceeds at the stated rate
  double smallest_step = 0;     ///< step that exceeds it in 99 of 100 cases
  double false_alarm_rate_per_hour = 0;
};

struct IdleIdentification {
  Estimate inertia;        ///< kg or kg m2
  Estimate viscous;        ///< N s/m or Nm s/rad
  Estimate coulomb;        ///< N or Nm
  Estimate constant_load;  ///< N or Nm; 0 +- 0 when the record cannot show it
  bool constant_load_fitted = false;
  Estimate constant_loss;     ///< W, still in the record; with what is off it not below nothing
  Estimate copper_loss;       ///< W/Nm2, likewise
  double friction_knee = 0;   ///< m or rad
  double residual_rms = 0;    ///< N or Nm, at the cutoff of the fit
  double residual_share = 0;  ///< residual_rms over rms change of the effort, same filter
  double motion_s = 0;        ///< length of the record in motion
  double highest_speed = 0;   ///< m/s or rad/s
  /// m/s or rad/s up to which the torque of inertia shows the torque constant within 5 %: beyond it
  /// the record says nothing of it. 0: nowhere.
  double constant_known_to = 0;
  /// The torque constant falls with speed, and this is how.
  std::optional<EffectSetting> field_weakening;
  Estimate base_speed, weakening_exponent;
  /// Speed and current per torque, where that follows no power of the speed; else empty.
  std::vector<std::pair<double, Estimate>> current_per_torque;
  /// It falls with current, and this is how. Knee in N or Nm, at the constant of low currents.
  std::optional<EffectSetting> torque_saturation;
  Estimate saturation_knee, saturation_share;
  /// Highest effort [N or Nm] up to which the record would show that, and the standard error of the
  /// share of the effort that is lost there. 0: it shows nothing of it.
  double saturation_seen_to = 0, saturation_seen_error = 0;
  /// Highest effort of the run.
  double highest_effort = 0;
  double fit_cutoff_rad_s = 0;
  DetectabilityFloor floor;
  std::vector<std::string> remarks;  ///< sentences on what the record could not show
};

/// What a record lacks that is refused.
enum class IdleRefusal {
  none,
  stands,  ///< the drive does not move
  motion,  ///< the motion cannot show the parameters; thresholds can be learned all the same
  effort,  ///< the effort is not that of an idling drive; nothing can be learned
};

/// Identifies one drive. `base` gives cutoffs, effects and the knee to start from; its inertia and
/// friction are ignored. Data error with what to record when the motion cannot show a parameter.
Expected<IdleIdentification> identify_idle(const DisturbanceObserverConfig& base,
                                           const DriveRecord& record,
                                           const IdleOptions& options = {},
                                           IdleRefusal* why = nullptr);

/// True for a record that moves no further than friction takes to show.
[[nodiscard]] bool drive_stands(const DisturbanceObserverConfig& observer,
                                const DriveRecord& record);

/// Mean effort [N or Nm] against the motion where the drive runs at more than a share of its
/// highest speed, and the mean speed [m/s or rad/s]: friction at that speed, and a load if there is
/// one.
struct RunningEffort {
  double effort = 0, speed = 0;
};
[[nodiscard]] RunningEffort running_effort(const DriveRecord& record, double above = 0.5);

/// The drive model with the identified values put in.
[[nodiscard]] DriveModelConfig identified_drive(const DriveModelConfig& base,
                                                const IdleIdentification& found);

/// What the observer reads in motion from sample `from` on, rms about zero; 0 when it never moves.
[[nodiscard]] double idle_reading(const DisturbanceObserverConfig& observer,
                                  const DriveRecord& record, std::size_t from = 0);

/// Whether the constant load that was found makes the observer read less in the last third of the
/// record, with the load that the first two thirds show; of a record too short for that, with that
/// of the whole.
[[nodiscard]] bool load_helps(const DisturbanceObserverConfig& base, const DriveRecord& record,
                              const IdleIdentification& found, const IdleOptions& options = {});

/// True for the samples in motion: those long enough after a standstill or a fault that the filters
/// of `observer` no longer remember it.
[[nodiscard]] std::vector<bool> samples_in_motion(const DisturbanceObserverConfig& observer,
                                                  const DriveRecord& record);

}  // namespace servosense
