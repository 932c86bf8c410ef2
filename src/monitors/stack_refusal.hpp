// A refused configuration, in the words of the machine file that it was made from.
#pragma once

#include <initializer_list>
#include <string_view>

#include "servosense/core/expected.hpp"
#include "servosense/core/status.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/monitor_stack_config.hpp"

namespace servosense {

/// What HostStack::validate refuses of `config`, as a sentence that names the line, section and key
/// of `machine` that the field comes from. `spindle`: that in the slot of the spindle.
[[nodiscard]] Expected<Done> accepted(const MachineFile& machine, const HostStackConfig& config,
                                      Channel spindle);

}  // namespace servosense
