// What the ways of servosense identify modes --trace share: the column that swings, with the turns
// of the spindle beside it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/identify/free_decay.hpp"

namespace servosense::cli {

struct ModesTrace {
  std::string column;
  std::vector<DecayRecord> records;
  std::vector<std::string> remarks;  ///< the first: modal mass is unknown
  std::optional<double> from_hz, to_hz;
};

/// The traces and the band that the arguments say. Usage error: options of receptances.
Expected<ModesTrace> read_modes_trace(const Arguments& arguments);

/// "value +- standard error", both times `scale`.
std::string with_error(const Estimate& e, double scale);

}  // namespace servosense::cli
