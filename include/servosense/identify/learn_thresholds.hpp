// Thresholds of the monitors from an idling run: what the machine does by itself raises no alarm.
#pragma once

#include "servosense/identify/idle.hpp"
#include "servosense/monitors/idle_statistics.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

/// Disturbance jerk of one axis [N/s]. `observer` and `collision` as planned for the stack, drive
/// identified.
IdleStatistics learn_collision(const DisturbanceObserverConfig& observer,
                               const CollisionConfig& collision, const DriveRecord& record);

/// Chatter power of the spindle [Nm2], once a sample while it turns fast enough. Forced vibration
/// has no threshold that an idle run could teach: every cut is stronger.
IdleStatistics learn_chatter(const DisturbanceObserverConfig& observer,
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
