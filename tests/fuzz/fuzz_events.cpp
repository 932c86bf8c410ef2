// Any bytes as an event stream: an error of one line, or events whose own lines read back alike.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <sstream>

#include "servosense/io/event.hpp"

using namespace servosense;

namespace {

void require(bool ok) {
  if (!ok) std::abort();
}

bool same(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Expected<std::vector<Event>> events = read_events(
      std::make_unique<std::istringstream>(std::string(reinterpret_cast<const char*>(data), size)),
      "fuzz");
  if (!events) {
    require(events.error().sentence.find('\n') == std::string::npos);
    return 0;
  }
  for (const Event& event : *events) {
    const std::string line = to_json_line(event);
    require(line.find('\n') == std::string::npos);
    const Expected<Event> again = event_from_json(line, "again:1");
    require(again.has_value());
    require(same(again->t_s, event.t_s) && same(again->value, event.value) &&
            same(again->threshold, event.threshold) && again->extra == event.extra);
    require(again->monitor == event.monitor && again->channel == event.channel &&
            again->state == event.state && again->unit == event.unit &&
            again->reason == event.reason);
  }
  return 0;
}
