// The names of the monitors, there and back.
#include <cstring>
#include <set>

#include "check.hpp"
#include "servosense/core/monitor_id.hpp"

using namespace servosense;

int main() {
  std::set<std::string_view> seen;
  for (std::size_t i = 0; i < kMonitorCount; ++i) {
    const auto id = static_cast<MonitorId>(i);
    CHECK(monitor_from(kMonitorNames[i]) == id);
    CHECK(std::strlen(name_of(id)) == kMonitorNames[i].size());  // ends where its view does
    CHECK(seen.insert(kMonitorNames[i]).second);
  }
  // What files and other programs hold: the numbers of the C interface follow the same order.
  CHECK(std::string_view(name_of(MonitorId::chatter)) == "chatter");
  CHECK(std::string_view(name_of(MonitorId::drill_fracture)) == "drill-fracture");
  CHECK(std::string_view(name_of(MonitorId::torque_band)) == "torque-band");
  CHECK(std::string_view(name_of(MonitorId::signal)) == "signal");
  CHECK(!monitor_from("chat"));
  CHECK(!monitor_from(""));
  return check::done();
}
