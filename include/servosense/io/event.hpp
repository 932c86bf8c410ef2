// Events of the monitors as JSON Lines: one object a line. The format: docs/files.md.
#pragma once

#include <functional>
#include <iosfwd>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/core/monitor_id.hpp"
#include "servosense/core/monitor_state.hpp"
#include "servosense/io/json.hpp"

namespace servosense {

/// One change of a monitor's state. Numbers that are not finite are written as null and read as
/// NaN.
struct Event {
  double t_s = 0;
  MonitorId monitor = MonitorId::signal;
  std::string channel;
  MonitorState state = MonitorState::idle;
  double value = 0;
  double threshold = 0;
  std::string unit;    ///< of value and threshold
  std::string reason;  ///< a sentence
  /// Further numbers, written behind the others; read from keys that are not known.
  std::vector<std::pair<std::string, double>> extra;
};

/// Writes the object of an event, in the order of the contract; `more` writes further members.
void write_event(JsonWriter& json, const Event& event, const std::function<void()>& more = {});

/// The object, on one line, without the line end.
[[nodiscard]] std::string to_json_line(const Event& event);

/// One line of an event stream. Strict JSON; every key of the contract must be there once, unknown
/// keys are tolerated. `where` ("FILE:LINE") begins the sentence of a data error.
Expected<Event> event_from_json(std::string_view line, const std::string& where);

/// Reads an event file; blank lines are passed over. Data error naming file and line for anything
/// malformed, device error if the file cannot be read.
Expected<std::vector<Event>> read_events(const std::string& path);
/// The same from a stream; `name` stands for the file in error sentences.
Expected<std::vector<Event>> read_events(std::unique_ptr<std::istream> stream, std::string name);

}  // namespace servosense
