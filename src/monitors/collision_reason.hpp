// What the collision monitor of an axis does, in words.
#pragma once

#include <string>

#include "servosense/monitors/monitor_stack_config.hpp"

namespace servosense {

/// The end of the sentence that says what the monitor fires on: what holds where the tool may cut,
/// and what to do about it. `config`: spindle and cut as planned.
std::string collision_in_the_cut(const HostStackConfig& config, const CollisionConfig& axis,
                                 bool turns);

}  // namespace servosense
