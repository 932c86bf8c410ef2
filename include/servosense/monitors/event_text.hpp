// Alarms in words: the event that a change of state becomes.
#pragma once

#include "servosense/core/units.hpp"
#include "servosense/io/event.hpp"
#include "servosense/monitors/monitor_stack.hpp"

namespace servosense {

/// Event of the stream, with a sentence that says what the state means.
[[nodiscard]] Event event_from(const StateChange<double>& change, Nanoseconds t_ns);

}  // namespace servosense
