// Before a command runs: nothing that it writes is something that it reads or writes already, and
// all of it can be written. What it reads and writes is in the table of its options.
#pragma once

#include "arguments.hpp"

namespace servosense::cli {

/// Usage error when an output is an input, a file that an input names, or another output, whatever
/// the names are; device error when an output could not be written.
Expected<Done> check_outputs(const Command& command, const Arguments& arguments);

/// Usage error for a pipe or device, which gives its bytes once.
Expected<Done> check_rereadable(const std::string& path);

}  // namespace servosense::cli
