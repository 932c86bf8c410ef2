// Files of the reader: programs, tool tables, parameters.
#include <filesystem>
#include <sstream>

#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"
#include "servosense/process/program/program_reader.hpp"

namespace servosense::process {
namespace {

Expected<std::vector<std::string>> all_lines(LineReader reader) {
  std::vector<std::string> lines;
  std::string_view line;
  for (;;) {
    const auto more = reader.next(line);
    if (!more) return more.error();
    if (!*more) return lines;
    if (reader.bytes_consumed() > kLargestProgram)
      return data_error(reader.name() + ": the program is larger than " +
                        std::to_string(kLargestProgram >> 20U) + " MiB; split it");
    lines.emplace_back(line);
  }
}

Expected<LineReader> reader_of(const std::string& path) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  return LineReader(std::move(*stream), path);
}

LineReader reader_of(std::string_view text, const std::string& name) {
  return {std::make_unique<std::istringstream>(std::string(text)), name};
}

Expected<ToolTable> tools_from(LineReader reader) {
  ToolTable table;
  std::string_view line;
  for (;;) {
    const auto more = reader.next(line);
    if (!more) return more.error();
    if (!*more) return table;
    const std::size_t semicolon = line.find(';');
    std::istringstream words{std::string(line.substr(0, semicolon))};
    Tool tool;
    if (semicolon != std::string_view::npos) tool.remark = trim(line.substr(semicolon + 1));
    bool any = false, numbered = false;
    for (std::string word; words >> word; any = true) {
      const char letter =
          static_cast<char>(word[0] >= 'a' && word[0] <= 'z' ? word[0] - 'a' + 'A' : word[0]);
      const auto number = parse_number(std::string_view(word).substr(1));
      if (!number.ok())
        return reader.error_here("a word of a tool is a letter and a number, not " +
                                 in_quotes(word));
      constexpr std::string_view kAxes = "XYZABCUVW";
      if (const std::size_t axis = kAxes.find(letter); axis != std::string_view::npos)
        tool.offset[axis] = number.value / (axis >= 3 && axis < 6 ? 1 : 1000);
      else if (letter == 'T' || letter == 'P' || letter == 'Q') {
        if (number.value != static_cast<int>(number.value) || number.value < 0)
          return reader.error_here(std::string(1, letter) + " of a tool is a whole number, not " +
                                   in_quotes(word));
        (letter == 'T'   ? tool.number
         : letter == 'P' ? tool.pocket
                         : tool.orientation) = static_cast<int>(number.value);
        numbered = numbered || letter == 'T';
      } else if (letter == 'D') {
        tool.diameter_m = number.value / 1000;
      } else if (letter == 'I') {
        tool.front_angle_deg = number.value;
      } else if (letter == 'J') {
        tool.back_angle_deg = number.value;
      } else {
        return reader.error_here("the words of a tool are T P X Y Z A B C U V W D I J Q, not " +
                                 in_quotes(word));
      }
    }
    if (!any) continue;
    if (!numbered) return reader.error_here("a tool has no number; give it as T");
    const int number = tool.number;
    if (!table.emplace(number, std::move(tool)).second)
      return reader.error_here("tool " + std::to_string(number) +
                               " stands twice; keep one of them");
  }
}

Expected<std::map<long, double>> parameters_from(LineReader reader) {
  std::map<long, double> parameters;
  std::string_view line;
  for (;;) {
    const auto more = reader.next(line);
    if (!more) return more.error();
    if (!*more) return parameters;
    std::istringstream words{std::string(line)};
    std::string index_text, value_text, rest;
    if (!(words >> index_text)) continue;
    words >> value_text;
    const auto index = parse_counts(index_text);
    const auto value = parse_number(value_text);
    if (!index.ok() || !value.ok() || words >> rest)
      return reader.error_here("a line is the number of a parameter and its value, not " +
                               in_quotes(trim(line)));
    if (index.value < 1 || index.value > kLastParameter)
      return reader.error_here("there is no parameter " + index_text + "; they are 1 to " +
                               std::to_string(kLastParameter));
    parameters[static_cast<long>(index.value)] = value.value;
  }
}

}  // namespace

Expected<ProgramText> ProgramText::read(const std::string& path) {
  auto reader = reader_of(path);
  if (!reader) return reader.error();
  auto lines = all_lines(std::move(*reader));
  if (!lines) return lines.error();
  ProgramText text;
  text.name_ = path;
  text.folder_ = std::filesystem::path(path).parent_path().string();
  if (text.folder_.empty()) text.folder_ = ".";
  text.lines_ = std::move(*lines);
  return text;
}

ProgramText ProgramText::from(std::string_view content, std::string name) {
  ProgramText text;
  text.name_ = std::move(name);
  if (auto lines = all_lines(reader_of(content, text.name_))) text.lines_ = std::move(*lines);
  return text;
}

Expected<std::optional<ProgramText>> ProgramText::subroutine(const std::string& name) const {
  std::optional<ProgramText> none;
  if (folder_.empty() || name.find('/') != std::string::npos || name.starts_with('.')) return none;
  const std::string path = (std::filesystem::path(folder_) / (name + ".ngc")).string();
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return none;
  auto text = read(path);
  if (!text) return text.error();
  return std::optional<ProgramText>(std::move(*text));
}

Expected<ToolTable> read_tool_table(const std::string& path) {
  auto reader = reader_of(path);
  if (!reader) return reader.error();
  return tools_from(std::move(*reader));
}
Expected<ToolTable> tool_table_of(std::string_view text, const std::string& name) {
  return tools_from(reader_of(text, name));
}
Expected<std::map<long, double>> read_parameter_file(const std::string& path) {
  auto reader = reader_of(path);
  if (!reader) return reader.error();
  return parameters_from(std::move(*reader));
}
Expected<std::map<long, double>> parameters_of(std::string_view text, const std::string& name) {
  return parameters_from(reader_of(text, name));
}

}  // namespace servosense::process
