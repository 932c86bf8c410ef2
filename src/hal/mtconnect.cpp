#include "servosense/hal/mtconnect.hpp"

#include <algorithm>

#include "servosense/io/text.hpp"

namespace servosense {
namespace {

std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : printable(text, std::string::npos)) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

// Letters, digits and underlines: what an identifier may be made of.
std::string identifier(std::string_view text) {
  std::string out;
  for (const char c : text) {
    const bool kept = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    out += kept ? c : '_';
  }
  return out.empty() ? "machine" : out;
}

// Identifiers are those of all machines in an agent, names those of one: the adapter says names.
std::string named(const std::string& device, const std::string& name) {
  return " id=\"" + device + '_' + name + "\" name=\"" + name + '"';
}

std::string sample(const std::string& device, const std::string& name, const char* type,
                   const char* units) {
  return "            <DataItem category=\"SAMPLE\"" + named(device, name) + " type=\"" + type +
         "\" units=\"" + units + "\"/>\n";
}

std::string condition(const std::string& device, const std::string& name) {
  return "            <DataItem category=\"CONDITION\"" + named(device, name) +
         " type=\"SYSTEM\"/>\n";
}

}  // namespace

std::string effort_item(Channel drive) {
  return std::string(name_of(drive)) + (is_turning(drive) ? "_torque" : "_force");
}
std::string speed_item(Channel drive) { return std::string(name_of(drive)) + "_speed"; }

std::string condition_item(std::string_view monitor, std::string_view channel) {
  return identifier(monitor) + '_' + identifier(channel);
}

std::string_view condition_level(MonitorState state) {
  switch (state) {
    case MonitorState::alarm:
      return "FAULT";
    case MonitorState::warning:
      return "WARNING";
    case MonitorState::signal_fault:
    case MonitorState::learning:
      return "UNAVAILABLE";
    case MonitorState::idle:
    case MonitorState::armed:
      break;
  }
  return "NORMAL";
}

void publish(ShdrServer& server, Nanoseconds t_ns, const Event& event) {
  server.condition(t_ns, condition_item(name_of(event.monitor), event.channel),
                   condition_level(event.state), name_of(event.state), event.reason);
}

std::string device_file(const MtconnectDevice& device) {
  std::string id = identifier(device.name);
  if (id[0] >= '0' && id[0] <= '9') id.insert(0, "machine_");  // XML begins no name with a digit
  std::string out =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<MTConnectDevices xmlns=\"urn:mtconnect.org:MTConnectDevices:2.0\"\n"
      "    xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\"\n"
      "    xsi:schemaLocation=\"urn:mtconnect.org:MTConnectDevices:2.0 "
      "http://schemas.mtconnect.org/schemas/MTConnectDevices_2.0.xsd\">\n"
      "  <Header creationTime=\"1970-01-01T00:00:00Z\" sender=\"servosense\" instanceId=\"1\" "
      "version=\"2.0\" bufferSize=\"131072\"/>\n"
      "  <Devices>\n"
      "    <Device id=\"" +
      id + "\" name=\"" + id + "\" uuid=\"servosense-" + id +
      "\">\n"
      "      <Description>" +
      escaped(device.name) +
      "</Description>\n"
      "      <DataItems>\n"
      "        <DataItem category=\"EVENT\"" +
      named(id, "avail") + " type=\"AVAILABILITY\"/>\n";
  // What is watched on no axis, such as the tool, belongs to the machine.
  for (const auto& [monitor, of] : device.monitors)
    if (std::ranges::none_of(device.channels,
                             [&watched = of](Channel c) { return name_of(c) == watched; }))
      out += condition(id, condition_item(monitor, of));
  out += "      </DataItems>\n      <Components><Axes" + named(id, "axes") + "><Components>\n";
  for (const Channel drive : device.channels) {
    const std::string channel(name_of(drive));
    const bool turns = is_turning(drive);
    const char* const kind = turns ? "Rotary" : "Linear";
    out += "        <" + std::string(kind) + named(id, channel) + ">\n          <DataItems>\n";
    if (turns) {
      out += sample(id, effort_item(drive), "TORQUE", "NEWTON_METER");
      out += sample(id, speed_item(drive), "ROTARY_VELOCITY", "REVOLUTION/MINUTE");
    } else {
      out += sample(id, effort_item(drive), "LINEAR_FORCE", "NEWTON");
    }
    for (const auto& [monitor, of] : device.monitors)
      if (of == channel) out += condition(id, condition_item(monitor, channel));
    out += "          </DataItems>\n        </" + std::string(kind) + ">\n";
  }
  return out +
         "      </Components></Axes></Components>\n    </Device>\n  </Devices>\n"
         "</MTConnectDevices>\n";
}

}  // namespace servosense
