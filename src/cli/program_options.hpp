// Options of the commands that read an NC program.
#pragma once

#include <vector>

#include "arguments.hpp"
#include "servosense/process/motion/plain_time.hpp"
#include "servosense/process/program/program_reader.hpp"

namespace servosense::cli {

/// --tools, --parameters, --dialect, --block-delete.
[[nodiscard]] std::vector<Option> program_options();
Expected<process::ProgramOptions> program_options_of(const Arguments& arguments);

}  // namespace servosense::cli
