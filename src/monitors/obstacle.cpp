#include "obstacle.hpp"

#include <utility>

#include "servosense/monitors/learned_under.hpp"

namespace servosense {

bool enabled(const MachineFile& machine, const std::string& section) {
  return machine.flag(section, "enabled").value_or(true);
}

void keep_from(MonitorAvailability& m, Obstacle obstacle) {
  m.runs = false;
  m.obstacle = std::move(obstacle.word);
  m.reason = std::move(obstacle.sentence);
}

Obstacle elsewhere(const MachineFile& machine, const StackPlan& plan, MonitorId monitor,
                   Channel channel) {
  std::string sentence = learned_elsewhere(machine, plan.stack_of(channel), monitor, channel);
  return {sentence.empty() ? "" : "other conditions", std::move(sentence)};
}

std::string unknown_conditions(const MachineFile& machine, MonitorId monitor, Channel channel) {
  return states_conditions(machine, monitor, channel)
             ? ""
             : "; the machine file does not say what its threshold was learned under: set by hand?";
}

Obstacle no_spindle() {
  return {"no signals", "needs the spindle's angle or speed and its current or torque"};
}
Obstacle no_axis(Channel axis) {
  return {"no signals",
          is_turning(axis)
              ? "needs the axis's angle or speed and its current or torque"
              : "needs the axis's position or velocity and its current, torque or force"};
}

Obstacle switched_off() { return {"switched off", "switched off in the machine file"}; }

}  // namespace servosense
