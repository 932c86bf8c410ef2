// From a machine file to the dynamometer filter of one direction.
#pragma once

#include <optional>

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/observer/dynamometer_filter.hpp"

namespace servosense {

/// Of `[dynamometer.x] modes` (direction 'x', 'y' or 'z') and what `[dynamometer]` says; harmonics:
/// else three times the teeth of the tool, at least 12. Nothing where the file has no modes of that
/// direction. Data error, naming the file's line, for modes that the sample rate is too low for.
Expected<std::optional<DynamometerFilterConfig>> dynamometer_config(const MachineFile& machine,
                                                                    char direction,
                                                                    double sample_period_s);

}  // namespace servosense
