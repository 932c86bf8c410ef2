// How the monitors appear to MTConnect: names of data items, levels of conditions, and the device
// file that an agent needs beside the adapter (hal/shdr_server.hpp).
//
//   samples     <channel>_torque [Nm], <channel>_speed [1/min], <channel>_force [N]: means over the
//               time since the last one
//   conditions  <monitor>_<channel>: NORMAL, WARNING, FAULT; UNAVAILABLE while a monitor learns or
//               cannot trust its signals. The native code is the monitor's state
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/hal/shdr_server.hpp"
#include "servosense/io/event.hpp"

namespace servosense {

/// "spindle_torque", "x_force" and, of what turns, "spindle_speed".
[[nodiscard]] std::string effort_item(Channel drive);
[[nodiscard]] std::string speed_item(Channel drive);
/// "chatter_spindle" for chatter on the spindle.
[[nodiscard]] std::string condition_item(std::string_view monitor, std::string_view channel);
/// Level of a condition for the state of a monitor.
[[nodiscard]] std::string_view condition_level(MonitorState state);
/// Sends an event as a condition.
void publish(ShdrServer& server, Nanoseconds t_ns, const Event& event);

struct MtconnectDevice {
  std::string name;                                           ///< of the machine
  std::vector<Channel> channels;                              ///< drives
  std::vector<std::pair<std::string, std::string>> monitors;  ///< name, channel
};
/// The device file (MTConnect 2.0).
[[nodiscard]] std::string device_file(const MtconnectDevice& device);

}  // namespace servosense
