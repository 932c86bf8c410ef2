// Traces of a hammer and of what answers it, for the commands that make a response of them.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "console.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/identify/impact.hpp"
#include "servosense/io/trace.hpp"

namespace servosense::cli {

struct HammerRecords {
  Signal response;
  std::vector<ImpactRecord> records;
};

/// Which columns may be the response.
struct ResponseWanted {
  std::function<bool(Signal)> is;
  std::optional<std::string> name;  ///< if it is named
  const char* what = "";            ///< "that is a displacement"
  const char* record = "";          ///< what to record when there is none
};

/// hammer.force_N and one response, of all traces that the command names. Data error where a trace
/// has none or another; usage error where it has several and none is named.
Expected<HammerRecords> read_hammer_records(const Arguments& arguments,
                                            const ResponseWanted& wanted, Progress& progress);

}  // namespace servosense::cli
