// A finished run of `servosense monitor`, as people and as programs read it.
#pragma once

#include "monitor_session.hpp"

namespace servosense::cli {

void print_summary(const MonitorRun& run);
/// One JSON object on standard output (docs/json.md).
void print_monitor_json(const MonitorRun& run);

}  // namespace servosense::cli
