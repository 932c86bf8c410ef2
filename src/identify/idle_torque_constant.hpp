// How torque per ampere falls with speed and with current, both sought in an idling run.
#pragma once

#include "idle_design.hpp"

namespace servosense::idle_fit {

/// Puts what is found into `config` and `found`; false when nothing is. Each is sought with the
/// other taken off, in turn, until the saturation moves no more.
bool take_torque_constant(DisturbanceObserverConfig& config, const DriveRecord& record,
                          const IdleOptions& options, bool with_load, IdleIdentification& found);

}  // namespace servosense::idle_fit
