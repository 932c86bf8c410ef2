// servosense identify modes --trace: modes without a hammer, from what rings when a cut ends.
#pragma once

#include "arguments.hpp"

namespace servosense::cli {

/// Exit status of the program.
int run_modes_of_decays(const Arguments& arguments);

}  // namespace servosense::cli
