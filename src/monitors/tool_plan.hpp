// The tool monitors' part of a stack plan.
#pragma once

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

/// From this rate on drill fracture, wear and torque band make do with half, and the monitors may
/// hear of groups of samples: 8 kHz and its rounding.
inline constexpr double kHalfRateFrom_hz = 7999;

/// Tooth breakage (both ways), drill fracture, wear and torque band, as far as machine file and
/// signals allow. To be called when the drives are planned.
Expected<Done> plan_tool(const MachineFile& machine, const StackSignals& signals, StackPlan& plan);

}  // namespace servosense
