#include "program_options.hpp"

#include <utility>

#include "servosense/io/text.hpp"

namespace servosense::cli {

std::vector<Option> program_options() {
  return {{"--tools", "FILE", "tool table of LinuxCNC (.tbl), millimetres", false, FileUse::input},
          {"--parameters", "FILE", "parameters of LinuxCNC (.var), work offsets among them", false,
           FileUse::input},
          {"--dialect", "NAME", "linuxcnc or fanuc (linuxcnc)"},
          {"--feed-override", "PERCENT", "of feeds not bound to the spindle (100)"},
          {"--rapid-override", "PERCENT", "of rapids (100)"},
          {"--block-delete", "", "leaves out lines that begin with '/'"}};
}

namespace {

Expected<process::ProgramOptions> options_of(const Arguments& arguments) {
  process::ProgramOptions options;
  const std::string dialect = arguments.value("--dialect").value_or("linuxcnc");
  if (dialect == "fanuc")
    options.dialect = process::Dialect::fanuc;
  else if (dialect != "linuxcnc")
    return usage_error("--dialect is linuxcnc or fanuc, not " + in_quotes(dialect));
  options.block_delete = arguments.has("--block-delete");
  if (const auto path = arguments.value("--tools")) {
    auto tools = process::read_tool_table(*path);
    if (!tools) return tools.error();
    options.tools = std::move(*tools);
  }
  if (const auto path = arguments.value("--parameters")) {
    auto parameters = process::read_parameter_file(*path);
    if (!parameters) return parameters.error();
    options.parameters = std::move(*parameters);
  }
  return options;
}

}  // namespace

Expected<AskedProgram> asked_program(const Arguments& arguments, const std::string& command) {
  if (arguments.operands().size() != 1) return usage_error(command + " reads one program; name it");
  auto options = options_of(arguments);
  if (!options) return options.error();
  auto text = process::ProgramText::read(arguments.operands()[0]);
  if (!text) return text.error();
  return AskedProgram{std::move(*options), std::move(*text)};
}

}  // namespace servosense::cli
