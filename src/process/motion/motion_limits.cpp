#include "servosense/process/motion/motion_limits.hpp"

namespace servosense::process {

MachineMotion machine_motion(const MachineFile& machine) {
  MachineMotion motion;
  for (std::size_t i = 0; i < 3; ++i) {
    const char axis = "xyz"[i];
    const auto read = [&](const char* key, double& into) {
      const auto value = machine.number(std::string("axis.") + axis, key);
      if (value) into = *value;
      return value.has_value();
    };
    if (!read("max_velocity_m_s", motion.limits.velocity_m_s[i])) motion.unknown_velocity += axis;
    if (!read("max_acceleration_m_s2", motion.limits.acceleration_m_s2[i]))
      motion.unknown_acceleration += axis;
    (void)read("max_jerk_m_s3", motion.limits.jerk_m_s3[i]);
  }
  motion.limits.tool_change_s = machine.number("machine", "tool_change_s").value_or(0);
  if (machine.flag("machine", "waits_for_spindle").value_or(false)) {
    const auto start_s = machine.number("machine", "spindle_start_s");
    motion.limits.spindle_start_s = start_s.value_or(0);
    motion.unknown_spindle_start = !start_s;
  }
  return motion;
}

}  // namespace servosense::process
