// What a learned threshold holds under.
//
// A threshold is the noise of one machine as one monitor hears it: at a sample rate, through
// filters, from an encoder, in a window, for a tool. Learned under one set of these and used under
// another it means nothing: the noise of a count grows with the square of the cutoff and the rate,
// chatter sums other parts of a revolution with other teeth. No law carries it over for noise of
// unknown colour. So each condition stands beside the threshold in [monitor.<name>] as a key
// learned_*, and a monitor whose present conditions differ does not run.
#pragma once

#include <string>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/monitor_stack_config.hpp"

namespace servosense {

/// Writes the present conditions of what was learned from `drive` (chatter and breakage of the
/// spindle, collision of an axis) beside it; `config` is that of its stack (StackPlan::stack_of).
/// Thresholds of the same section that were learned under others are removed; returns a sentence
/// for each. Call it after the thresholds are set.
std::vector<std::string> write_learned_under(MachineFile& machine, const HostStackConfig& config,
                                             Channel drive);

/// A sentence on what differs between the conditions that the machine file states for a monitor and
/// the present ones; empty when nothing does, or nothing is stated.
[[nodiscard]] std::string learned_elsewhere(const MachineFile& machine,
                                            const HostStackConfig& config, MonitorId monitor,
                                            Channel channel);

/// Whether the machine file says what a monitor's thresholds hold under.
[[nodiscard]] bool states_conditions(const MachineFile& machine, MonitorId monitor,
                                     Channel channel);

}  // namespace servosense
