// The page that `servosense monitor --report` writes.
#pragma once

#include <string>

#include "monitor_session.hpp"
#include "servosense/core/expected.hpp"

namespace servosense::cli {

/// `path` as given by the user.
Expected<Done> write_monitor_report(const MonitorRun& run, const std::string& path);

}  // namespace servosense::cli
