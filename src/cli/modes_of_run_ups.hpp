// servosense identify modes --trace --run-ups: modes without a hammer, from the harmonics of the
// rotation that sweep through them.
#pragma once

#include "arguments.hpp"

namespace servosense::cli {

/// Exit status of the program.
int run_modes_of_run_ups(const Arguments& arguments);

}  // namespace servosense::cli
