// The drives' part of a stack plan: observer, chatter, collision and signal health of each.
#pragma once

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/observer/machine_config.hpp"

namespace servosense {

// Koike 2016, table 3-3.
inline constexpr double kCollisionCutoff_rad_s = 335;
// Range of the blocks that hear a revolution (angle_sampler.hpp).
inline constexpr double kSamplesATurn = 8;

/// Cutoffs that a section states, of both filters alike; `standard` where it does not.
[[nodiscard]] ObserverCutoffs own_cutoffs(const MachineFile& machine, const std::string& section,
                                          double standard);

Expected<Done> plan_spindle(const MachineFile& machine, Channel channel, DriveSignal signal,
                            double period, StackPlan& plan);
Expected<Done> plan_axis(const MachineFile& machine, Channel channel, DriveSignal signal,
                         double period, StackPlan& plan);

}  // namespace servosense
