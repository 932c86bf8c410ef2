// Left to itself: the model integrated forward under the measured effort, from measured states, for
// a short while (Janot, Gautier and Brunot 2019 simulate whole records, in closed loop; without a
// loop an axis integrates every error twice, so only a short horizon says something).
//
//   J dv/dt = u(t - late) - resistance(x, v) - D v,   x(0), v(0) as measured
//
// with model/drive_model.hpp, the members that simulator and observer call, by the simulator's
// leapfrog (sim/drive_simulator.hpp). Backlash, springs, bristles and clocks are first led along
// the measured motion from the start of the record. Bad at: starts just before a standstill, where
// a trifle decides when the drive sticks.
#pragma once

#include <cstdint>

#include "reconcile/drive/signals.hpp"
#include "servosense/model/drive_model.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {

inline constexpr double kMostSteps = 3e7;  ///< of integration: some seconds

/// A model and the time by which the reported effort reaches it late.
struct FreeModel {
  DriveModelConfig drive;
  double late_s = 0;
  Column constant_ratio = {};  ///< of the constant over that of the data, a sample each; empty: 1
};

struct FreeRunConditions {
  double from_s = 0, to_s = 0;  ///< part of the record in which runs begin and end
  double least_speed = 0;       ///< at which they begin [m/s or rad/s]
  double force_noise = 0;       ///< rms behind the filter of the comparison [N or Nm]
  std::uint64_t seed = 1;       ///< of starts and noise
};

/// Runs of 50, 100, 200 and 500 ms from up to 64 starts spread over the given part, the ends of
/// the longest run being clear of faults. Where no room is for eight long ones, shorter ones only.
[[nodiscard]] FreeRun free_run(const DriveData& data, const DriveSignals& signals,
                               const FreeModel& before, const FreeModel& after,
                               const FreeRunConditions& conditions);

}  // namespace servosense::reconcile
