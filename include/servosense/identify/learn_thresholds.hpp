// Thresholds of the monitors from an idling run: what the machine does by itself raises no alarm.
//
// Collision (Koike 2016, section 5.4): mean + 6 sigma of the disturbance jerk.
// Chatter: the source sets its thresholds by hand. Here: chatter and forced power of the idle run,
// mean + 6 sigma, and no less than 1.5 times the largest power seen; from samples in motion only.
#pragma once

#include <cstdint>

#include "servosense/identify/idle.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

struct LearnedThreshold {
  double mean = 0;
  double sigma = 0;
  double peak = 0;        ///< largest value (for jerk: magnitude) of the idle run
  double threshold = 0;   ///< 0 when there was nothing to learn from
  std::uint64_t samples = 0;
};

/// Jerk of one axis. `observer` and `collision` as planned for the stack, drive identified.
LearnedThreshold learn_collision(const DisturbanceObserverConfig& observer,
                                 const CollisionConfig& collision, const DriveRecord& record);

struct LearnedChatter {
  LearnedThreshold chatter;  ///< Nm2
  LearnedThreshold forced;   ///< Nm2
};

/// Vibration power of the spindle.
LearnedChatter learn_chatter(const DisturbanceObserverConfig& observer,
                             const ChatterConfig& chatter, const DriveRecord& record);

}  // namespace servosense
