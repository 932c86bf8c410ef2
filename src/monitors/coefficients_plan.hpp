// The cutting coefficients' part of a stack plan.
#pragma once

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

/// Where the file has [monitor.cutting-coefficients]: its line of the plan, and its configuration
/// when tool, cut and signals allow. To be called when the drives and their cut are planned.
Expected<Done> plan_coefficients(const MachineFile& machine, double period, StackPlan& plan);
/// Behind the torque band: its program's engagements, for those coefficients.
Expected<Done> plan_engagements(const MachineFile& machine, StackPlan& plan);

}  // namespace servosense
