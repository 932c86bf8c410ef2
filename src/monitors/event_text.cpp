#include "servosense/monitors/event_text.hpp"

#include <string>

namespace servosense {
namespace {

std::string drive_name(Channel channel) {
  return channel == Channel::spindle ? "spindle" : "axis " + std::string(name_of(channel));
}

std::string what_happened(const StateChange<double>& c) {
  const bool chatter = c.monitor == MonitorId::chatter;
  switch (c.state) {
    case MonitorState::alarm:
      if (!chatter)
        return "the force on " + drive_name(c.channel) +
               " changes as fast as in a collision or when a tool breaks";
      return "strong vibration at no multiple of the spindle speed";
    case MonitorState::warning:
      if (!chatter) return "the force on " + drive_name(c.channel) + " changes unusually fast";
      return c.forced ? "forced vibration is growing"
                      : "vibration off the spindle's harmonics is growing";
    case MonitorState::signal_fault:
      return "the signals of " + drive_name(c.channel) + " cannot be trusted; no statement is made";
    case MonitorState::learning:
      return "filters and windows are filling";
    case MonitorState::idle:
      return chatter ? "the spindle turns too slowly to be watched" : "nothing to watch";
    case MonitorState::armed:
      if (c.before == MonitorState::alarm || c.before == MonitorState::warning)
        return "back below the release level";
      return "watching";
  }
  return "";
}

}  // namespace

Event event_from(const StateChange<double>& change, Nanoseconds t_ns) {
  Event event;
  event.t_s = seconds_from(t_ns);
  event.monitor = name_of(change.monitor);
  event.channel = name_of(change.channel);
  event.state = name_of(change.state);
  event.value = change.value;
  event.threshold = change.threshold;
  event.unit = change.monitor == MonitorId::chatter ? "Nm2" : "N/s";
  event.reason = what_happened(change);
  return event;
}

}  // namespace servosense
