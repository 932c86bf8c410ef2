// From the machine file to the configuration of drives and observers.
#pragma once

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/observer/drive_config.hpp"

namespace servosense {

/// Reads [spindle], [observer.spindle] and [effect.spindle.*]. Missing numbers keep their defaults
/// (no inertia, no friction), so a machine that is yet to be identified can be read. Data error
/// naming the section for what no block accepts.
Expected<SpindleConfig> spindle_config(const MachineFile& machine);

/// The same for [axis.x], [axis.y] or [axis.z].
Expected<AxisConfig> axis_config(const MachineFile& machine, Channel axis);

/// Effects of one channel that the real-time model can carry; others (of the tool, or reported
/// only) are passed over.
Expected<DriveEffectsConfig> drive_effects_config(const MachineFile& machine, Channel channel);

}  // namespace servosense
