// What keeps a monitor of a stack plan from running, in the words of the machine file.
#pragma once

#include <string>

#include "servosense/core/channel.hpp"
#include "servosense/core/monitor_id.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

/// Nothing when it can run.
struct Obstacle {
  std::string word;
  std::string sentence;
  [[nodiscard]] bool none() const { return word.empty(); }
};

void keep_from(MonitorAvailability& m, Obstacle obstacle);
[[nodiscard]] bool enabled(const MachineFile& machine, const std::string& section);
[[nodiscard]] Obstacle switched_off();
[[nodiscard]] Obstacle no_spindle();
[[nodiscard]] Obstacle no_axis(Channel axis);
/// Of a threshold that was learned under other conditions than those of the plan.
[[nodiscard]] Obstacle elsewhere(const MachineFile& machine, const StackPlan& plan,
                                 MonitorId monitor, Channel channel);
/// Said of a monitor that runs all the same.
[[nodiscard]] std::string unknown_conditions(const MachineFile& machine, MonitorId monitor,
                                             Channel channel);

}  // namespace servosense
