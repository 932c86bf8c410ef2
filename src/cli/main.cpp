// servosense: the command-line program.
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <exception>
#include <iostream>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "help.hpp"
#include "output_check.hpp"
#include "servosense/io/text.hpp"

namespace servosense::cli {
namespace {

/// Words that make up the name of a command, from the first on.
std::string typed_name(const std::string& name, const std::vector<std::string>& words) {
  const auto parts = 1 + std::count(name.begin(), name.end(), ' ');
  std::string typed;
  for (long i = 0; i < parts && i < static_cast<long>(words.size()); ++i)
    typed += (i > 0 ? " " : "") + words[static_cast<std::size_t>(i)];
  return typed;
}

int print(const std::string& text, std::FILE* to = stdout) {
  std::fputs(text.c_str(), to);
  return to == stdout ? 0 : 2;
}

/// Help for people: on a terminal its paragraphs are as wide as that.
int explain(const std::string& text, std::FILE* to = stdout) {
  const auto width = terminal_width(to);
  return print(width ? fitted_paragraphs(text, *width) : text, to);
}

int unknown(const std::vector<std::string>& words, const std::vector<Command>& commands) {
  std::vector<std::string_view> names;
  for (const Command& command : commands) names.push_back(command.name);
  std::string typed = words[0];
  for (const Command& command : commands)
    if (words.size() > 1 && command.name.starts_with(words[0] + " ")) {
      typed += " " + words[1];
      break;
    }
  return fail(usage_error("there is no command '" + typed + "'; did you mean '" +
                          std::string(nearest_name(typed, names)) +
                          "'? 'servosense --help' lists them all"));
}

/// `servosense help [COMMAND]`, and what shells and manuals are made from.
int help(const std::vector<std::string>& words, const std::vector<Command>& commands) {
  if (words.empty()) return explain(overview_text(commands));
  if (words[0] == "--man") return print(man_page(commands, SERVOSENSE_VERSION));
  if (words[0] == "--bash-completion") return print(bash_completion(commands));
  if (words[0] == "--zsh-completion") return print(zsh_completion(commands));
  for (const Command& command : commands)
    if (typed_name(command.name, words) == command.name) return explain(help_text(command));
  for (const Command& command : commands)
    if (words.size() == 1 && command.name.starts_with(words[0] + " "))
      return explain(overview_text(commands, words[0]));
  return unknown(words, commands);
}

bool asks_help(const std::string& word) { return word == "--help" || word == "-h"; }

int run(const std::vector<std::string>& words) {
  const std::vector<Program> programs = {monitor_program(),
                                         identify_idle_program(),
                                         identify_presliding_program(),
                                         identify_collision_program(),
                                         identify_torque_band_program(),
                                         identify_torque_equation_program(),
                                         identify_torque_tolerance_program(),
                                         identify_reference_program(),
                                         identify_cutting_program(),
                                         identify_load_meter_program(),
                                         identify_modes_program(),
                                         identify_transfer_program(),
                                         identify_impact_program(),
                                         identify_dynamometer_program(),
                                         compensate_dynamometer_program(),
                                         reconcile_program(),
                                         study_encoder_program(),
                                         study_cutoff_program(),
                                         study_order_program(),
                                         study_warm_up_program(),
                                         lobes_program(),
                                         recommend_program(),
                                         pockets_program(),
                                         program_motion_program(),
                                         program_predict_program(),
                                         program_check_program(),
                                         program_optimise_program(),
                                         simulate_drive_program(),
                                         simulate_milling_program(),
                                         init_program(),
                                         import_program(),
                                         export_program(),
                                         report_program()};
  std::vector<Command> commands;
  for (const Program& program : programs) commands.push_back(program.command);
  errors_as_json(std::find(words.begin(), words.end(), "--json") != words.end());
  if (words.empty()) return explain(overview_text(commands), stderr);
  if (asks_help(words[0])) return help({}, commands);
  if (words[0] == "help") return help({words.begin() + 1, words.end()}, commands);
  if (words[0] == "--version" || words[0] == "-V") {
    std::printf("servosense %s\n", SERVOSENSE_VERSION);
    return 0;
  }
  for (const Program& program : programs) {
    const std::string& name = program.command.name;
    if (typed_name(name, words) != name) continue;
    const std::vector<std::string> rest(
        words.begin() + 1 + std::count(name.begin(), name.end(), ' '), words.end());
    auto arguments = Arguments::parse(program.command, rest);
    if (!arguments) return fail(arguments.error());
    if (arguments->help()) return explain(help_text(program.command));
    if (auto done = check_outputs(program.command, *arguments); !done) return fail(done.error());
    return program.run(*arguments);
  }
  if (words.size() == 2 && asks_help(words[1])) return help({words[0]}, commands);
  return unknown(words, commands);
}

/// What is printed must not end up in a file that takes the number of a closed stream, and a file
/// that reaches the user's limit is a full disk, no reason to die.
void prepare_streams() {
  for (int fd = ::open("/dev/null", O_RDONLY); fd >= 0; fd = ::open("/dev/null", O_RDONLY))
    if (fd > STDERR_FILENO) {
      ::close(fd);
      break;
    }
  std::signal(SIGXFSZ, SIG_IGN);
}

/// A result that nobody can read is none.
int delivered(int status) {
  std::cout.flush();
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout) return status;
  return complain(
      device_error("not everything could be written to standard output; is the disk full?"));
}

}  // namespace
}  // namespace servosense::cli

int main(int argc, char** argv) {
  using namespace servosense;
  cli::prepare_streams();
  try {
    return cli::delivered(cli::run(std::vector<std::string>(argv + 1, argv + argc)));
  } catch (const std::exception& e) {
    return cli::fail(
        device_error(std::string("out of memory or a fault of the program: ") + e.what()));
  }
}
