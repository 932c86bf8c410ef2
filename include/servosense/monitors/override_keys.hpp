// From the section [override] of the machine file to the configuration of OverrideControl.
#pragma once

#include <optional>

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/override_control.hpp"

namespace servosense {

/// Nothing without the section. Data error for limits that do not go together.
Expected<std::optional<OverrideConfig>> override_config(const MachineFile& machine,
                                                        double sample_period_s);

}  // namespace servosense
