// Whether a record that is said to be idle holds a cut.
//
// Purpose: what is learned from a cut as if it were idling makes every monitor deaf.
// Method: at a speed that does not change, idling effort does not jump. Means over windows of 0.1
// s; where the speed stays within 0.3 %, the median of three windows is held against that of the
// three after the next: a step of more than half the running effort, and of eight times what
// neighbouring windows differ by, is a tool that enters or leaves. Friction that drifts, a ripple
// and what the position makes of it change by less within half a second. And what repeats with each
// revolution of the spindle: in the air its torque has less than half the running torque, in an
// interrupted cut more. Bad at: cuts lighter than half the running effort; records that hold one
// cut and no air, of an axis, or of a spindle whose many teeth make an even torque.
#pragma once

#include <optional>
#include <string>

#include "servosense/identify/idle.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

/// A sentence on what shows the cut; nothing where the record may be idle.
[[nodiscard]] std::optional<std::string> effort_jumps(const DriveRecord& record);
/// The same from what repeats with the spindle. `observer` with the drive's parameters.
[[nodiscard]] std::optional<std::string> torque_repeats(const DisturbanceObserverConfig& observer,
                                                        const ChatterConfig& chatter,
                                                        const DriveRecord& record);

}  // namespace servosense
