#include "servosense/io/event.hpp"

#include <algorithm>
#include <cstdint>
#include <istream>
#include <limits>
#include <span>
#include <sstream>

#include "json_scanner.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

/// Reads the JSON of one event; what is wrong stands in `json.fault`.
class EventParser {
 public:
  explicit EventParser(std::string_view text) : json(text) {}

  JsonScanner json;

  bool parse(Event& event) {
    if (!json.object([&](std::string key) { return member(event, std::move(key)); })) return false;
    for (const std::string_view key : kKeys)
      if (!json.seen(key)) return json.fail("the key '" + std::string(key) + "' is missing");
    const auto monitor = monitor_from(monitor_);
    if (!monitor) return unknown("monitor", monitor_, kMonitorNames);
    const auto state = monitor_state_from(state_);
    if (!state) return unknown("state", state_, kMonitorStateNames);
    event.monitor = *monitor;
    event.state = *state;
    return true;
  }

 private:
  static constexpr std::array<std::string_view, 8> kKeys = {
      "t_s", "monitor", "channel", "state", "value", "threshold", "unit", "reason"};

  bool unknown(const char* what, std::string_view name, std::span<const std::string_view> names) {
    return json.fail(std::string("unknown ") + what + " " + in_quotes(name) +
                     ", the nearest known one is '" + std::string(nearest_name(name, names)) + "'");
  }
  bool member(Event& event, std::string key) {
    if (key == "t_s") return json.number_or_null(event.t_s);
    if (key == "value") return json.number_or_null(event.value);
    if (key == "threshold") return json.number_or_null(event.threshold);
    if (key == "monitor") return json.string(monitor_);
    if (key == "channel") return json.string(event.channel);
    if (key == "state") return json.string(state_);
    if (key == "unit") return json.string(event.unit);
    if (key == "reason") return json.string(event.reason);
    if (!json.at_number()) return json.skip_value();
    double value = 0;
    if (!json.number(value)) return false;
    event.extra.emplace_back(std::move(key), value);
    return true;
  }

  std::string monitor_, state_;  // as they are spelled
};

}  // namespace

void write_event(JsonWriter& json, const Event& event, const std::function<void()>& more) {
  json.begin_object();
  json.member("t_s", event.t_s);
  json.member("monitor", name_of(event.monitor));
  json.member("channel", event.channel);
  json.member("state", name_of(event.state));
  json.member("value", event.value);
  json.member("threshold", event.threshold);
  json.member("unit", event.unit);
  json.member("reason", event.reason);
  for (const auto& [name, number] : event.extra) json.member(name, number);
  if (more) more();
  json.end_object();
}

std::string to_json_line(const Event& event) {
  std::ostringstream out;
  JsonWriter json(out);
  write_event(json, event);
  return std::move(out).str();
}

Expected<Event> event_from_json(std::string_view line, const std::string& where) {
  Event event;
  EventParser parser(line);
  if (parser.parse(event)) return event;
  return data_error(where + ": " + parser.json.fault +
                    "; give one JSON object a line, as servosense monitor writes it");
}

Expected<std::vector<Event>> read_events(const std::string& path) {
  Expected<std::unique_ptr<std::istream>> file = open_for_reading(path);
  if (!file) return file.error();
  return read_events(std::move(*file), path);
}

Expected<std::vector<Event>> read_events(std::unique_ptr<std::istream> stream, std::string name) {
  LineReader lines(std::move(stream), std::move(name));
  std::vector<Event> events;
  for (;;) {
    std::string_view line;
    const Expected<bool> more = lines.next(line);
    if (!more) return more.error();
    if (!*more) return events;
    if (trim(line).empty()) continue;
    Expected<Event> event =
        event_from_json(line, lines.name() + ":" + std::to_string(lines.line_number()));
    if (!event) return event.error();
    events.push_back(std::move(*event));
  }
}

}  // namespace servosense
