// Options of the commands that read an NC program.
#pragma once

#include <string>
#include <vector>

#include "arguments.hpp"
#include "servosense/process/program/program_reader.hpp"

namespace servosense::cli {

/// --tools, --parameters, --dialect, --block-delete, --feed-override, --rapid-override.
[[nodiscard]] std::vector<Option> program_options();
/// The one program that is named, and how to read it.
struct AskedProgram {
  process::ProgramOptions options;
  process::ProgramText text;
};
/// Usage error unless it is one; errors of its file and of the options.
Expected<AskedProgram> asked_program(const Arguments& arguments, const std::string& command);

}  // namespace servosense::cli
