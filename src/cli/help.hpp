// What the program says of itself, all from the table of its commands: overview, help of a command
// or of a group of commands, man page, completion in a shell.
#pragma once

#include <span>
#include <string>

#include "arguments.hpp"

namespace servosense::cli {

/// Text of `servosense --help`; with `group` ("identify"), only the commands of that group.
std::string overview_text(std::span<const Command> commands, const std::string& group = {});

/// Text of `servosense <command> --help`.
std::string help_text(const Command& command);

/// Page of `man servosense`, in the macros of man(7).
std::string man_page(std::span<const Command> commands, const std::string& version);

/// Completion of commands and options for bash.
std::string bash_completion(std::span<const Command> commands);
/// The same for zsh, with what each means.
std::string zsh_completion(std::span<const Command> commands);

}  // namespace servosense::cli
