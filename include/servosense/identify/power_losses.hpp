// What a power that a spindle reports loses on its way to the shaft, from an idling run.
//
// The power over the speed is the torque, and what is lost over the speed: the constant loss as P0
// / w, that of the windings as k T^2 / w. Beside inertia and friction both are regressors of the
// idle fit (identify/idle.hpp): run-ups and run-downs differ by the windings, slow and fast runs by
// the constant. Taken off, fitted again until nothing is left. No loss is left out because it is
// small beside its error: inertia and friction would take it and state too small an error. One that
// comes out negative is 0, with the error that it has.
#pragma once

#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/io/drive_columns.hpp"

namespace servosense {

/// Share of the highest speed of a record, slower than which its power is not looked at.
inline constexpr double kSlowestShare = 0.03;
/// Times k T of the speed: faster, braking gives back more than the windings take, and half of what
/// a torque changes of the power is left.
inline constexpr double kTellsTimesCopper = 4;

struct FoundLosses {
  Estimate constant_W, copper_W_per_Nm2;
  /// Slower, what the fit leaves of the power is more than 5 % of the largest torque of the run, or
  /// its copper loss half of what braking with it gives back and more.
  double known_from_rad_s = 0;
};

/// The effort of columns that hold a power [W], without its losses, or a load, to torque.
void torque_of_load(std::vector<DriveSample<double>>& samples, double sample_period_s,
                    const DriveColumns& columns);
/// Takes the losses off such torques.
void take_off_losses(std::vector<DriveSample<double>>& samples, double sample_period_s,
                     const PowerReading& power);
/// Marks what is too slow for the power to tell its torque.
void mark_too_slow(std::vector<DriveSample<double>>& samples, double sample_period_s,
                   double known_from_rad_s, Quality mark);

/// The same, with a straight line from what is fast enough to what is again in the place of the
/// effort.
void bridge_too_slow(std::vector<DriveSample<double>>& samples, double sample_period_s,
                     double known_from_rad_s, Quality mark);

/// Speed from which on a record is looked at: 3 % of its highest, at least `least`.
[[nodiscard]] double slowest_of_power(const DriveRecord& record, double least_rad_s);

/// Takes the losses off a record of such torques and tells them; what is too slow must be marked as
/// a gap. Data error as of identify_idle(), with the record as it was.
Expected<FoundLosses> find_power_losses(const DisturbanceObserverConfig& base, DriveRecord& record,
                                        double known_from_rad_s, const IdleOptions& options);

}  // namespace servosense
