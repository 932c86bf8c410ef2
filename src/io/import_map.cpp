#include "servosense/io/import_map.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "servosense/core/channel.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {
namespace {

using SeparatorName = std::pair<std::string_view, char>;
constexpr auto kSeparatorNames = std::to_array<SeparatorName>({{"semicolon", ';'},
                                                               {"comma", ','},
                                                               {"tab", '\t'},
                                                               {"blank", ' '},
                                                               {"bar", '|'},
                                                               {"none", '\0'},
                                                               {";", ';'},
                                                               {",", ','},
                                                               {"|", '|'},
                                                               {"\\t", '\t'}});

/// Why a name is no column of a trace; empty when it is one.
std::string fault_of_name(std::string_view name) {
  if (name == "t_s" || name == "-") return {};
  const std::size_t dot = name.find('.');
  std::vector<std::string_view> nearest;
  const auto channel = channel_from(name.substr(0, dot));
  if (dot == std::string_view::npos)
    return in_quotes(name) +
           " is no column of a trace; write it like spindle.current_A, t_s for "
           "the time, or - to leave the column out";
  if (!channel)
    return "unknown channel " + in_quotes(name.substr(0, dot)) + " in " + in_quotes(name) +
           "; the nearest known one is '" +
           std::string(nearest_name(name.substr(0, dot), kChannelNames)) + "'";
  if (!quantity_from(name.substr(dot + 1)))
    return "unknown quantity " + in_quotes(name.substr(dot + 1)) + " in " + in_quotes(name) +
           "; the nearest known one is '" +
           std::string(nearest_name(name.substr(dot + 1), kQuantityNames)) + "'";
  return {};
}

}  // namespace

Expected<ImportEntry> import_entry_from(std::string_view text) {
  const std::size_t equals = text.find('=');
  const std::string_view to = trim(text.substr(0, equals));
  if (equals == std::string_view::npos || to.empty() || trim(text.substr(equals + 1)).empty())
    return usage_error(in_quotes(text) +
                       " is no column; write NEW=OLD:UNIT, like x.current_A=I_q:A");
  if (const std::string fault = fault_of_name(to); !fault.empty()) return usage_error(fault);
  return ImportEntry{std::string(to), std::string(trim(text.substr(equals + 1))), false};
}

Expected<ImportWhere> import_where_from(std::string_view text) {
  // The heading may hold such a sign, the number cannot.
  const std::size_t equals = text.rfind('=');
  const auto value = parse_number(equals == std::string_view::npos ? std::string_view()
                                                                   : trim(text.substr(equals + 1)));
  const std::string_view column = trim(text.substr(0, equals));
  if (!value.ok() || column.empty())
    return usage_error(in_quotes(text) +
                       " names no rows; write OLD=VALUE, the heading of a column and a number, "
                       "like cut_signal=0");
  return ImportWhere{std::string(column), value.value, 0};
}

Expected<char> separator_from(std::string_view text) {
  for (const auto& [name, separator] : kSeparatorNames)
    if (name == text) return separator;
  return usage_error("the separator is " + in_quotes(text) +
                     ", must be semicolon, comma, tab, blank, bar or none");
}

Expected<DecimalMark> decimal_mark_from(std::string_view text) {
  if (text == "point" || text == ".") return DecimalMark::point;
  if (text == "comma" || text == ",") return DecimalMark::comma;
  return usage_error("the decimal mark is " + in_quotes(text) + ", must be point or comma");
}

Expected<ImportMap> read_import_map(const std::string& path) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  LineReader lines(std::move(*stream), path);
  ImportMap map;
  for (std::string_view line;;) {
    const auto more = lines.next(line);
    if (!more) return more.error();
    if (!*more) break;
    line = trim(line);
    if (line.empty() || line.starts_with('#')) continue;
    const std::size_t equals = line.find('=');
    const std::string_view key = trim(line.substr(0, equals));
    const std::string_view value =
        equals == std::string_view::npos ? std::string_view() : trim(line.substr(equals + 1));
    if (key == "separator") {
      const auto separator = separator_from(value);
      if (!separator) return lines.error_here(separator.error().sentence);
      map.separator = *separator;
    } else if (key == "decimal") {
      const auto mark = decimal_mark_from(value);
      if (!mark) return lines.error_here(mark.error().sentence);
      map.mark = *mark;
    } else if (key == "rate") {
      const auto rate = parse_number(value);
      if (!rate.ok() || !(rate.value > 0))
        return lines.error_here("rate is " + in_quotes(value) +
                                ", must be a number of rows a second");
      map.rate_hz = rate.value;
    } else if (key == "only") {
      map.only = value == "yes";
    } else if (key == "where") {
      auto where = import_where_from(value);
      if (!where) return lines.error_here(where.error().sentence);
      if (map.where) where->apart_s = map.where->apart_s;
      map.where = std::move(*where);
    } else if (key == "apart") {
      const auto apart = parse_number(value);
      if (!map.where || !apart.ok() || !(apart.value >= 0))
        return lines.error_here("apart is " + in_quotes(value) +
                                ", must be seconds, in a line below 'where = OLD=VALUE'");
      map.where->apart_s = apart.value;
    } else {
      auto entry = import_entry_from(line);
      if (!entry) return lines.error_here(entry.error().sentence);
      entry->in_map = true;
      map.entries.push_back(std::move(*entry));
    }
  }
  return map;
}

std::string import_map_text(const ImportMap& map, std::string_view source) {
  std::string text = "# map of servosense import, made from " + printable(source, 400) + "\n";
  if (map.separator)
    for (const auto& [name, separator] : kSeparatorNames)
      if (separator == *map.separator) {
        text += "separator = " + std::string(name) + "\n";
        break;
      }
  if (map.mark)
    text +=
        std::string("decimal = ") + (*map.mark == DecimalMark::point ? "point" : "comma") + "\n";
  if (map.rate_hz) text += "rate = " + number_text(*map.rate_hz) + "\n";
  if (map.only) text += "only = yes\n";
  if (map.where)
    text += "where = " + map.where->column + "=" + number_text(map.where->value) +
            "\napart = " + number_text(map.where->apart_s) + "\n";
  for (const ImportEntry& entry : map.entries) text += entry.to + " = " + entry.from + "\n";
  return text;
}

ImportMap overridden(ImportMap map, const ImportMap& flags) {
  // Entries of the flags stand behind: the last one of a column counts. One that says anew what a
  // trace column is made of takes the map's away.
  for (const ImportEntry& flag : flags.entries)
    if (flag.to != "-")
      std::erase_if(map.entries, [&](const ImportEntry& e) { return e.to == flag.to; });
  map.entries.insert(map.entries.end(), flags.entries.begin(), flags.entries.end());
  if (flags.separator) map.separator = flags.separator;
  if (flags.mark) map.mark = flags.mark;
  if (flags.rate_hz) map.rate_hz = flags.rate_hz;
  if (flags.where) map.where = flags.where;
  map.only = map.only || flags.only;
  return map;
}

}  // namespace servosense
