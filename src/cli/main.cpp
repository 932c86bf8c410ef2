// servosense: the command-line program.
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <exception>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/io/text.hpp"

namespace servosense::cli {
namespace {

int overview(const std::vector<Program>& programs, std::FILE* to) {
  std::fprintf(
      to,
      "servosense: cutting force and alarms from the signals that every servo drive has\n\n"
      "usage: servosense <command> [options]\n\n");
  for (const Program& program : programs)
    std::fprintf(to, "  %-16s %s\n", program.command.name.c_str(), program.command.summary.c_str());
  std::fprintf(to,
               "\n'servosense <command> --help' explains one command.\n"
               "A monitoring aid, not a safety function.\n");
  return to == stdout ? 0 : 2;
}

int run(const std::vector<std::string>& words) {
  const std::vector<Program> programs = {monitor_program(),
                                         identify_idle_program(),
                                         identify_collision_program(),
                                         lobes_program(),
                                         identify_torque_band_program(),
                                         simulate_drive_program(),
                                         simulate_milling_program(),
                                         pockets_program(),
                                         reconcile_program(),
                                         report_program()};
  if (words.empty()) return overview(programs, stderr);
  if (words[0] == "--help" || words[0] == "help") return overview(programs, stdout);
  if (words[0] == "--version") {
    std::printf("servosense %s\n", SERVOSENSE_VERSION);
    return 0;
  }
  for (const Program& program : programs) {
    const auto parts =
        1 + std::count(program.command.name.begin(), program.command.name.end(), ' ');
    std::string typed;
    for (long i = 0; i < parts && i < static_cast<long>(words.size()); ++i)
      typed += (i > 0 ? " " : "") + words[static_cast<std::size_t>(i)];
    if (typed != program.command.name) continue;
    const std::vector<std::string> rest(words.begin() + parts, words.end());
    auto arguments = Arguments::parse(program.command, rest);
    if (!arguments) return fail(arguments.error());
    if (arguments->help()) {
      std::fputs(help_text(program.command).c_str(), stdout);
      return 0;
    }
    return program.run(*arguments);
  }
  std::vector<std::string_view> names;
  for (const Program& program : programs) names.push_back(program.command.name);
  std::string typed = words[0];
  if (words.size() > 1 && (words[0] == "identify" || words[0] == "simulate"))
    typed += " " + words[1];
  return fail(usage_error("there is no command '" + typed + "'; did you mean '" +
                          std::string(nearest_name(typed, names)) +
                          "'? 'servosense --help' lists them all"));
}

}  // namespace
}  // namespace servosense::cli

int main(int argc, char** argv) {
  try {
    return servosense::cli::run(std::vector<std::string>(argv + 1, argv + argc));
  } catch (const std::exception& e) {
    std::fprintf(stderr, "servosense: out of memory or a fault of the program: %s\n", e.what());
    return 4;
  }
}
