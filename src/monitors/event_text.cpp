#include "servosense/monitors/event_text.hpp"

#include <cstdio>
#include <string>

namespace servosense {
namespace {

std::string drive_name(Channel channel) {
  return channel == Channel::spindle2 ? "second spindle"
         : channel == Channel::tool   ? "the tool"
         : is_axis(channel)           ? "axis " + std::string(name_of(channel))
                                      : std::string(name_of(channel));
}

std::string effort_on(Channel channel) {
  return (is_turning(channel) ? "the torque on " : "the force on ") + drive_name(channel);
}

std::string signal_text(const StateChange<double>& c) {
  const std::string drive = drive_name(c.channel);
  switch (static_cast<SignalCause>(c.detail)) {
    case SignalCause::none:
      return "the signals of " + drive + " are sound";
    case SignalCause::zeros:
      return drive + " has reported nothing but zeros yet";
    case SignalCause::jitter:
      return "samples of " + drive + " come late";
    case SignalCause::saturated:
      return drive + " gives all it can: its effort stays at the limit";
    case SignalCause::frozen_effort:
      return "the effort of " + drive + " does not change although it moves: is the current stuck?";
    case SignalCause::disorder:
      return "samples of " + drive + " are missing, doubled or out of order";
    case SignalCause::damaged:
      return "samples of " + drive + " are damaged";
    case SignalCause::jump:
      return drive +
             " reports what no drive does: a wild reading of encoder or current, or a counter "
             "narrower than stated";
    case SignalCause::too_many:
      return "too many samples of " + drive + " are faulty";
    case SignalCause::gap:
      return "samples of " + drive + " are missing for longer than can be bridged";
    case SignalCause::stale_effort:
      return "no new effort comes from " + drive + " although it moves";
    case SignalCause::stuck_encoder:
      return "the encoder of " + drive + " is stuck: it stopped as no mass can";
    case SignalCause::silent_bus:
      return "nothing arrives from " + drive;
  }
  return {};
}

// Steps have no warning.
std::string wear_text(WearRule rule, bool alarm) {
  switch (rule) {
    case WearRule::none:
      break;
    case WearRule::thrust_limit:
      return alarm ? "the mean thrust of the last holes is that of a worn tool"
                   : "the mean thrust of the last holes comes near that of a worn tool";
    case WearRule::thrust_rise:
      return "thrust has jumped from hole to hole: the tool has chipped";
    case WearRule::thrust_drop:
      return "thrust has dropped from hole to hole: the tool has fractured";
    case WearRule::thrust_ratio:
      return alarm ? "thrust has grown beyond its ratio to that of the first holes"
                   : "thrust grows towards its ratio to that of the first holes";
    case WearRule::torque_limit:
      return alarm ? "the mean torque of the last holes is that of a worn tool"
                   : "the mean torque of the last holes comes near that of a worn tool";
    case WearRule::torque_rise:
      return "torque has jumped from hole to hole: the tool has chipped";
    case WearRule::torque_drop:
      return "torque has dropped from hole to hole: the tool has fractured";
    case WearRule::specific_force_ratio:
      return alarm ? "the specific cutting force is that of a worn tool, whatever depth and feed"
                   : "the specific cutting force grows towards that of a worn tool";
    case WearRule::torque_ratio:
      return alarm ? "torque has grown beyond its ratio to that of the first holes"
                   : "torque grows towards its ratio to that of the first holes";
  }
  return "the tool wears";
}

// What a share of the torque that all cuts have in common, and so on, can be.
std::string explained(TorqueExplanation e, bool more) {
  switch (e) {
    case TorqueExplanation::here:
      return more ? "more stock in this place alone, or a tool that has just chipped"
                  : "less stock in this place alone, or a tooth that is lost";
    case TorqueExplanation::every:
      return more ? "a worn tool or harder material" : "softer material or another edge";
    case TorqueExplanation::diameter:
      return more ? "a tool of a larger diameter" : "a tool of a smaller diameter";
    case TorqueExplanation::height:
      break;
  }
  return more ? "stock that is too high, or a zero or tool that is too low"
              : "stock that is too low, or a zero or tool that is too high";
}

std::string torque_text(TorqueCause cause) {
  const std::string out = "the torque has left its band";
  using Kind = TorqueCause::Kind;
  switch (cause.kind()) {
    case Kind::unknown:
      return out;
    case Kind::never_cut:
      return out +
             ": nothing has been cut yet where the program cuts: the tool or the part is "
             "missing, or the part begins farther on";
    case Kind::not_cut:
      return out +
             ": nothing is cut where the program cuts, after it was: the tool is broken off, "
             "or there is less stock here";
    case Kind::cuts_air:
      return out +
             ": something is cut where the program cuts nothing: the stock is bigger or "
             "shifted, the zero or the tool is another";
    case Kind::teeth:
      return "the torque pulses as that of " + std::to_string(cause.teeth()) +
             (cause.teeth() == 1 ? " tooth" : " teeth") +
             ", not as the program's tool would: a wrong tool, or teeth that do not cut";
    case Kind::more:
    case Kind::less:
      break;
  }
  const bool more = cause.kind() == Kind::more;
  std::string can_be;
  int count = 0;
  for (const auto e : {TorqueExplanation::diameter, TorqueExplanation::height,
                       TorqueExplanation::every, TorqueExplanation::here})
    if (cause.can_be(e)) {
      can_be += (count == 0 ? "" : "; or ") + explained(e, more);
      ++count;
    }
  return out + (more ? " upwards: " : " downwards: ") +
         (count > 1 ? "the cuts so far do not tell which: " : "") + can_be;
}

constexpr const char* kForceHasChanged =
    "the specific cutting force has changed at once, by this share: edge, depth or material is "
    "another";

// One cause, one alarm: why chatter is silent.
std::string no_chatter(const StateChange<double>& c) {
  return c.steps ? "; the torque has stepped with it, so it is not judged as chatter" : "";
}

ChatterSign chatter_sign(const StateChange<double>& c) {
  return static_cast<ChatterSign>(c.detail);
}

// Who heard it, where that is no drive.
std::string in_sensor(Channel channel) {
  return channel == Channel::microphone      ? " in the sound"
         : channel == Channel::accelerometer ? " in the acceleration"
                                             : "";
}

std::string line_text(const StateChange<double>& c) {
  char text[128];
  std::snprintf(text, sizeof text,
                "vibration at no multiple of the spindle speed: a line of %.0f times its noise at "
                "%.1f +- %.1f Hz",
                c.value, c.frequency_hz, c.error_hz);
  return text + in_sensor(c.channel);
}

std::string alarm_text(const StateChange<double>& c) {
  switch (c.monitor) {
    case MonitorId::chatter:
      if (chatter_sign(c) == ChatterSign::line) return line_text(c);
      return "strong vibration at no multiple of the spindle speed" + in_sensor(c.channel);
    case MonitorId::collision:
      return effort_on(c.channel) + " changes as fast as in a collision or when a tool breaks";
    case MonitorId::drill_fracture:
      return "a force turns with the drill: a lip has broken off";
    case MonitorId::ar_breakage:
      return "the load of a tooth has moved to its neighbour for good: a tooth is broken" +
             no_chatter(c);
    case MonitorId::tooth_breakage:
      return "a tooth that cut a turn ago cuts no more" + no_chatter(c);
    case MonitorId::wear:
      return wear_text(static_cast<WearRule>(c.detail), true);
    case MonitorId::torque_band:
      return torque_text(TorqueCause::from_code(c.detail));
    case MonitorId::reference:
      return "the cut differs from the sound ones";
    case MonitorId::cutting_coefficients:  // only warns
    case MonitorId::signal:
      break;
  }
  return signal_text(c);
}

std::string warning_text(const StateChange<double>& c) {
  switch (c.monitor) {
    case MonitorId::chatter:
      return chatter_sign(c) == ChatterSign::forced
                 ? "forced vibration is growing"
                 : "vibration off the spindle's harmonics is growing";
    case MonitorId::collision:
      return effort_on(c.channel) + " changes unusually fast";
    case MonitorId::drill_fracture:
      return "the force that turns with the drill is growing";
    case MonitorId::ar_breakage:
      return "the load of a tooth has moved";
    case MonitorId::tooth_breakage:
      return c.detail != 0
                 ? "the teeth cut unequally: large run-out, or a tooth was lost out of the cut"
                 : "the load of a tooth has dropped";
    case MonitorId::wear:
      return wear_text(static_cast<WearRule>(c.detail), false);
    case MonitorId::torque_band:
      return "the torque is near the edge of its band";
    case MonitorId::cutting_coefficients:
      return kForceHasChanged;
    case MonitorId::reference:
    case MonitorId::signal:
      break;
  }
  return signal_text(c);
}

std::string what_happened(const StateChange<double>& c) {
  if (c.monitor == MonitorId::signal) return signal_text(c);
  switch (c.state) {
    case MonitorState::alarm:
      return alarm_text(c);
    case MonitorState::warning:
      return warning_text(c);
    case MonitorState::signal_fault:
      return "the signals of " + drive_name(c.channel) + " cannot be trusted; no statement is made";
    case MonitorState::learning:
      return c.monitor == MonitorId::cutting_coefficients ? "the first revolutions of cut teach it"
                                                          : "filters and windows are filling";
    case MonitorState::idle:
      if (c.monitor == MonitorId::torque_band) return "no program is under way";
      return c.monitor == MonitorId::collision ? "nothing to watch"
                                               : "the spindle turns too slowly to be watched";
    case MonitorState::armed:
      if (c.before == MonitorState::alarm || c.before == MonitorState::warning)
        return "back below the release level";
      return "watching";
  }
  return "";
}

const char* unit_of(const StateChange<double>& c) {
  switch (c.monitor) {
    case MonitorId::chatter:
      return chatter_sign(c) == ChatterSign::line  ? "1"
             : c.channel == Channel::microphone    ? "Pa2"
             : c.channel == Channel::accelerometer ? "m2/s4"
                                                   : "Nm2";
    case MonitorId::collision:
      return is_turning(c.channel) ? "Nm/s" : "N/s";
    case MonitorId::drill_fracture:
      return "N";
    case MonitorId::wear:
      if (const char* unit = unit_of(static_cast<WearRule>(c.detail)); *unit != '\0') return unit;
      return "1";
    case MonitorId::ar_breakage:
    case MonitorId::tooth_breakage:
    case MonitorId::torque_band:
    case MonitorId::reference:
    case MonitorId::cutting_coefficients:
    case MonitorId::signal:
      return "1";
  }
  return "";
}

}  // namespace

Event event_from(const StateChange<double>& change, Nanoseconds t_ns) {
  Event event;
  event.t_s = seconds_from(t_ns);
  event.monitor = change.monitor;
  event.channel = name_of(change.channel);
  event.state = change.state;
  event.value = change.value;
  event.threshold = change.threshold;
  event.unit = unit_of(change);
  event.reason = what_happened(change);
  if (change.frequency_hz > 0)
    event.extra = {{"frequency_hz", change.frequency_hz},
                   {"frequency_standard_error_hz", change.error_hz}};
  if (change.faulty > 0)
    event.reason += "; " + std::to_string(change.faulty) + " faulty samples so far";
  return event;
}

}  // namespace servosense
