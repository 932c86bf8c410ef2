// The torque band's part of a stack plan.
#pragma once

#include <string>

#include "obstacle.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

/// Reads the reference and configures the monitor for samples `pace_s` apart. What keeps it
/// from running.
Expected<Obstacle> plan_torque_band(const MachineFile& machine, double pace_s,
                                    const StackSignals& signals, StackPlan& plan);
/// What it watches, for one that runs.
std::string torque_band_watches(const StackPlan& plan, const StackSignals& signals);

}  // namespace servosense
