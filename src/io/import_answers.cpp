// What --column and the map say, as columns of the table at hand.
#include <algorithm>

#include "import_draft.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/trace.hpp"

namespace servosense::detail {
namespace {

std::string in_lower_case(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return out;
}

/// What stands before the brackets at the end of a heading, whatever is in them.
std::string_view before_brackets(std::string_view heading) {
  if (heading.empty() || (heading.back() != ']' && heading.back() != ')')) return heading;
  return trim(heading.substr(0, std::min(heading.find_first_of("[("), heading.size())));
}

/// Columns that OLD stands for: the whole heading, else its name without the unit, else without
/// what stands in brackets, else any of these in another case.
std::vector<std::size_t> columns_called(std::string_view old, const TableLayout& layout,
                                        const std::vector<HeadingMeaning>& meanings) {
  std::vector<std::size_t> found;
  if (old.starts_with('#')) {
    const auto number = parse_counts(old.substr(1));
    if (number.ok() && number.value >= 1 &&
        static_cast<std::size_t>(number.value) <= layout.headings.size())
      return {static_cast<std::size_t>(number.value) - 1};
  }
  const std::string small = in_lower_case(old);
  for (int way = 0; way < 6 && found.empty(); ++way)
    for (std::size_t i = 0; i < layout.headings.size(); ++i) {
      const std::string_view whole = layout.headings[i];
      if (whole.empty()) continue;
      const std::string_view part = way % 3 == 0   ? whole
                                    : way % 3 == 1 ? std::string_view(meanings[i].name)
                                                   : before_brackets(whole);
      if (way < 3 ? part == old : in_lower_case(part) == small) found.push_back(i);
    }
  return found;
}

struct OldAndUnit {
  std::vector<std::size_t> columns;
  std::string old, unit;
};

/// "I_q (A):A": the whole as a heading first, then what stands before the last colon.
OldAndUnit split_answer(const std::string& from, const TableLayout& layout,
                        const std::vector<HeadingMeaning>& meanings) {
  OldAndUnit whole{columns_called(from, layout, meanings), from, ""};
  if (!whole.columns.empty()) return whole;
  const std::size_t colon = from.rfind(':');
  if (colon == std::string::npos) return whole;
  const std::string old(trim(std::string_view(from).substr(0, colon)));
  return {columns_called(old, layout, meanings), old,
          std::string(trim(std::string_view(from).substr(colon + 1)))};
}

std::string nearest_heading(const TableLayout& layout, const std::vector<HeadingMeaning>& meanings,
                            const std::string& old) {
  const std::string places = "#1 to #" + std::to_string(layout.headings.size());
  if (!layout.has_heading) return "the table has no heading; say " + places;
  std::vector<std::string_view> names(layout.headings.begin(), layout.headings.end());
  for (const HeadingMeaning& m : meanings) names.push_back(m.name);
  std::erase(names, std::string_view());
  return "the nearest one is " + in_quotes(nearest_name(old, names)) + ", or say " + places;
}

Expected<ColumnAnswer> answer_of(const ImportEntry& entry, const OldAndUnit& found) {
  ColumnAnswer answer;
  answer.unit = found.unit;
  const auto as_written = [&](Dimension dimension) {
    if (const auto unit = unit_named(found.unit, dimension)) answer.unit = unit->spelling;
  };
  if (entry.to == "-") {
    answer.left_out = true;
  } else if (entry.to == "t_s") {
    answer.is_time = true;
    if (!found.unit.empty() && !unit_named(found.unit, Dimension::time))
      return usage_error(in_quotes(found.unit) +
                         " is no unit of time; write s, ms, us, ns, min or h");
  } else {
    const std::size_t dot = entry.to.find('.');
    const Signal signal{*channel_from(std::string_view(entry.to).substr(0, dot)),
                        *quantity_from(std::string_view(entry.to).substr(dot + 1))};
    answer.signal = signal;
    as_written(dimension_of(signal.quantity));
    if (!found.unit.empty() && !value_of_unit(answer.unit, signal.quantity)) {
      const bool known = unit_named(found.unit).has_value();
      const std::string_view own = unit_of(signal.quantity);
      return usage_error(
          in_quotes(found.unit) + " is no unit " + (known ? "of " + entry.to : "that is known") +
          (own.empty() ? "; it has none"
           : known     ? "; write one like " + std::string(own)
                   : "; the nearest known one is '" + std::string(nearest_unit(found.unit)) + "'"));
    }
  }
  return answer;
}

}  // namespace

std::string old_name(const TableLayout& layout, std::size_t column) {
  const std::string& heading = layout.headings[column];
  const auto same = std::count(layout.headings.begin(), layout.headings.end(), heading);
  if (heading.empty() || same > 1 || !is_shown_as_written(heading))
    return "#" + std::to_string(column + 1);
  return heading;
}

std::string named_column(const TableLayout& layout, std::size_t column) {
  const std::string old = old_name(layout, column);
  const std::string& heading = layout.headings[column];
  if (old == heading) return in_quotes(heading);
  return heading.empty() ? "column " + old : old + " " + in_quotes(heading);
}

std::string answer_option(const TableLayout& layout, std::size_t column, std::string_view to,
                          std::string_view unit) {
  std::string text = std::string(to) + "=" + old_name(layout, column);
  if (!unit.empty()) text += ":" + std::string(unit);
  const bool plain =
      text.find_first_not_of(
          "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.=:/-%+") ==
      std::string::npos;
  if (!plain && text.find('\'') == std::string::npos)
    text = "'" + text + "'";
  else if (!plain)
    text = "\"" + text + "\"";
  return "--column " + text;
}

Expected<std::size_t> column_of(const ImportWhere& where, const TableLayout& layout,
                                const std::vector<HeadingMeaning>& meanings,
                                const std::string& name) {
  const auto columns = columns_called(where.column, layout, meanings);
  if (columns.empty())
    return usage_error("where: " + name + " has no column " + in_quotes(where.column) + "; " +
                       nearest_heading(layout, meanings, where.column));
  if (columns.size() > 1)
    return usage_error("where: " + in_quotes(where.column) + " stands for several columns of " +
                       name + "; say #" + std::to_string(columns[0] + 1) + " or another place");
  return columns[0];
}

Expected<ColumnAnswers> resolve_answers(const ImportMap& map, const TableLayout& layout,
                                        const std::vector<HeadingMeaning>& meanings,
                                        const std::string& name) {
  ColumnAnswers answers;
  std::string missing;
  for (const ImportEntry& entry : map.entries) {
    const OldAndUnit found = split_answer(entry.from, layout, meanings);
    if (found.columns.empty()) {
      if (!entry.in_map)
        return usage_error(name + " has no column " + in_quotes(found.old) + "; " +
                           nearest_heading(layout, meanings, found.old));
      missing += (missing.empty() ? "" : ", ") + in_quotes(found.old);
      continue;
    }
    if (found.columns.size() > 1 && entry.to != "-") {
      std::string all;
      for (const std::size_t i : found.columns)
        all += (all.empty() ? "#" : " or #") + std::to_string(i + 1);
      return usage_error(in_quotes(found.old) + " stands for several columns of " + name +
                         "; say " + all);
    }
    const auto answer = answer_of(entry, found);
    if (!answer) return answer.error();
    for (const std::size_t column : found.columns) {
      const auto earlier = answers.find(column);
      if (earlier != answers.end() && !answer->left_out && !earlier->second.left_out)
        return usage_error("column " + named_column(layout, column) + " of " + name +
                           " is given twice; it can become one column of the trace");
      if (!answer->left_out)
        for (const auto& [other, said] : answers)
          if (other != column && ((answer->is_time && said.is_time) ||
                                  (answer->signal && said.signal == answer->signal)))
            return usage_error(entry.to + " is given twice, from " + named_column(layout, other) +
                               " and " + named_column(layout, column) + " of " + name);
      answers[column] = *answer;
    }
  }
  if (!missing.empty())
    return data_error(name + " lacks columns that the map names: " + missing +
                      "; it has another layout, make a map of its own for it");
  return answers;
}

}  // namespace servosense::detail
