// Event streams: the key order of the contract, strict reading, exact round trips.
#include <bit>
#include <limits>
#include <random>
#include <sstream>

#include "check.hpp"
#include "malformed.hpp"
#include "servosense/io/event.hpp"
#include "servosense/io/machine_keys.hpp"

using namespace servosense;

namespace {

Expected<std::vector<Event>> events_of(const std::string& text) {
  return read_events(std::make_unique<std::istringstream>(text), "memory");
}

void test_line() {
  Event event{1.5,    MonitorId::collision,
              "x",    MonitorState::alarm,
              812.25, 500,
              "N/s",  "Force on x rose by \"812\" N/s.",
              {}};
  CHECK_TEXT(
      to_json_line(event),
      R"({"t_s": 1.5, "monitor": "collision", "channel": "x", "state": "alarm", "value": 812.25, )"
      R"("threshold": 500, "unit": "N/s", "reason": "Force on x rose by \"812\" N/s."})");
  event.value = std::numeric_limits<double>::quiet_NaN();
  event.extra = {{"tooth", 3}};
  CHECK(to_json_line(event).find("\"value\": null, ") != std::string::npos);
  CHECK(to_json_line(event).ends_with(", \"tooth\": 3}"));
}

void test_reading() {
  const Expected<std::vector<Event>> events = events_of(
      "\n {\"reason\":\"a\\u00b5\\n\\ud83d\\ude00\\/\" , \"t_s\" : "
      "-1.5E+1,\"monitor\":\"ar-breakage\","
      "\"channel\":\"spindle\",\"state\":\"signal-fault\",\"value\":null,\"threshold\":0,\"unit\":"
      "\"\","
      "\"more\":{\"a\":[1,\"x\",{}],\"b\":null},\"flag\":true,\"order\":12,\"none\":null}\r\n\n");
  CHECK(events && events->size() == 1);
  if (!events || events->size() != 1) return;
  const Event& event = events->front();
  CHECK_TEXT(event.reason, "a\xC2\xB5\n\xF0\x9F\x98\x80/");
  CHECK(event.t_s == -15 && std::isnan(event.value) && event.threshold == 0);
  CHECK(event.extra == (std::vector<std::pair<std::string, double>>{{"order", 12}}));
  CHECK(events_of("")->empty());
}

void test_errors() {
  malformed::check_all("events", 15, [](const std::string& path) {
    const Expected<std::vector<Event>> events = read_events(path);
    return events ? Error{} : events.error();
  });
  const Expected<std::vector<Event>> absent = read_events("tests/data/absent.jsonl");
  CHECK(!absent && absent.error().kind == ErrorKind::device);
}

void test_round_trip() {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    std::mt19937_64 random(seed);
    const auto number = [&] {
      const auto value = std::bit_cast<double>(random());
      return std::isfinite(value) ? value : 0.0;
    };
    const auto words = [&] {
      constexpr std::array<const char*, 8> kPieces = {
          "a", "\"", "\\", "\n", "\x02", "\xC2\xB5", "\xF0\x9F\x98\x80", " "};
      std::string text;
      for (std::uint64_t i = random() % 12; i > 0; --i) text += kPieces[random() % kPieces.size()];
      return text;
    };
    std::vector<Event> events(5);
    std::string text;
    for (Event& e : events) {
      e = {number(),
           static_cast<MonitorId>(random() % kMonitorCount),
           words(),
           static_cast<MonitorState>(random() % kMonitorStateNames.size()),
           number(),
           number(),
           words(),
           words(),
           {{"k" + words(), number()}}};
      text += to_json_line(e) + "\n";
    }
    const Expected<std::vector<Event>> again = events_of(text);
    bool same = again && again->size() == events.size();
    for (std::size_t i = 0; same && i < events.size(); ++i) {
      const Event& a = events[i];
      const Event& b = (*again)[i];
      same = a.t_s == b.t_s && a.monitor == b.monitor && a.channel == b.channel &&
             a.state == b.state && a.value == b.value && a.threshold == b.threshold &&
             a.unit == b.unit && a.reason == b.reason && a.extra == b.extra;
    }
    ++check::checks;
    if (!same) check::fail(__FILE__, __LINE__) << "round trip, seed " << seed << '\n';
  }
}

}  // namespace

int main() {
  test_line();
  test_reading();
  test_errors();
  test_round_trip();
  return check::done();
}
