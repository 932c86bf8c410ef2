#include "table_layout.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "servosense/io/text.hpp"
#include "servosense/io/time_stamp.hpp"
#include "servosense/io/unit_name.hpp"
#include "table_text.hpp"

namespace servosense::detail {
namespace {

// In their order of preference, where two fit alike.
constexpr std::array<char, 6> kSeparators = {'\t', ';', ',', '|', ' ', '\0'};

bool is_table_number(std::string_view field) {
  for (const DecimalMark mark : {DecimalMark::point, DecimalMark::comma})
    if (table_number(field, mark).state == TableNumber::State::value)
      return field.find(' ') == std::string_view::npos;
  return time_stamp_from(field).has_value();
}

/// What the fields of one record are.
struct RecordKinds {
  std::size_t fields = 0, numbers = 0, missing = 0, texts = 0;
  [[nodiscard]] double values() const {
    return fields == 0 ? 0 : static_cast<double>(numbers + missing) / static_cast<double>(fields);
  }
};

RecordKinds kinds_of(const std::vector<std::string_view>& fields) {
  RecordKinds kinds;
  kinds.fields = fields.size();
  for (const std::string_view field : fields)
    if (is_table_number(field))
      ++kinds.numbers;
    else if (is_table_value(field))
      ++kinds.missing;
    else
      ++kinds.texts;
  return kinds;
}

/// How well a separator fits, over the last records of the sample.
struct SeparatorFit {
  std::size_t columns = 0;
  double score = 0;
  double typical_values = 0;  // share of the fields of a row
};

SeparatorFit fit_of(const std::vector<TableRecord>& records, char separator) {
  constexpr std::size_t kLookedAt = 300;
  const std::size_t from = records.size() > kLookedAt ? records.size() - kLookedAt : 0;
  struct Rows {
    std::size_t count = 0;
    double values = 0;
  };
  std::map<std::size_t, Rows> by_columns;
  std::vector<std::string_view> fields;
  std::vector<std::string> unquoted;
  std::size_t looked_at = 0;
  for (std::size_t i = from; i < records.size(); ++i) {
    ++looked_at;
    if (is_table_comment(records[i].text, separator)) continue;
    split_record(records[i].text, separator, fields, unquoted);
    const RecordKinds kinds = kinds_of(fields);
    if (kinds.numbers == 0) continue;
    Rows& rows = by_columns[fields.size()];
    ++rows.count;
    rows.values += kinds.values();
  }
  SeparatorFit best;
  for (const auto& [columns, rows] : by_columns) {
    if (columns < 2 && separator != '\0') continue;
    const double score = rows.values / static_cast<double>(looked_at);
    if (score <= best.score) continue;
    best = {columns, score, rows.values / static_cast<double>(rows.count)};
  }
  // One column is what is left when nothing separates.
  if (separator == '\0') best.score *= 0.5;
  // Blanks also stand within fields: between a date and a clock.
  if (separator == ' ') best.score *= 0.8;
  return best;
}

bool is_bracketed(std::string_view field) {
  return field.size() >= 2 && ((field.front() == '[' && field.back() == ']') ||
                               (field.front() == '(' && field.back() == ')'));
}

std::string_view without_brackets(std::string_view field) {
  return is_bracketed(field) ? trim(field.substr(1, field.size() - 2)) : field;
}

/// A line of units: most fields that are not empty are known ones, the others short or in brackets.
bool is_unit_line(const std::vector<std::string_view>& fields) {
  constexpr std::size_t kLongestUnit = 10;
  std::size_t units = 0, others = 0;
  for (const std::string_view field : fields) {
    const std::string_view bare = without_brackets(field);
    if (bare.empty() || bare.find_first_not_of('-') == std::string_view::npos) continue;
    if (unit_named(bare))
      ++units;
    else if (is_bracketed(field) || bare.size() <= kLongestUnit)
      others += is_bracketed(field) ? 0U : 1U;
    else
      return false;
  }
  return units > 0 && others <= units;
}

/// A line above the rows that may name the columns.
bool may_be_heading(const std::vector<std::string_view>& fields, std::size_t columns) {
  if (fields.size() != columns) return false;
  std::size_t names = 0;
  for (const std::string_view field : fields)
    if (!field.empty() && !is_table_number(field) &&
        field.find_first_not_of("-=+_ ") != std::string_view::npos)
      ++names;
  return 2 * names >= columns;
}

/// Fields of a heading: of blank-aligned tables, names may have single blanks within.
std::vector<std::string> heading_fields(std::string_view record, char separator,
                                        std::size_t columns) {
  std::vector<std::string_view> fields;
  std::vector<std::string> unquoted;
  split_row(record, separator, columns, fields, unquoted);
  std::vector<std::string> names(fields.begin(), fields.end());
  if (separator != ' ' || names.size() == columns) return names;
  std::vector<std::string> wide;
  std::string_view left = trim(record);
  while (!left.empty()) {
    const std::size_t gap = std::min(left.find("  "), left.find('\t'));
    wide.emplace_back(trim(left.substr(0, gap)));
    left = gap == std::string_view::npos ? std::string_view() : trim(left.substr(gap));
  }
  return wide.size() == columns ? wide : names;
}

std::string_view comment_content(std::string_view record) {
  record = trim(record);
  const std::size_t signs = record.find_first_not_of("#%/;! ");
  return signs == std::string_view::npos ? std::string_view() : record.substr(signs);
}

class LayoutFinder {
 public:
  LayoutFinder(const std::vector<TableRecord>& records, const TableOptions& options)
      : records_(records), options_(options) {}

  std::optional<std::string> find_separator() {
    for (const char separator : kSeparators) {
      if (options_.separator && *options_.separator != separator) continue;
      const SeparatorFit fit = fit_of(records_, separator);
      if (fit.score <= fit_.score + 1e-9) continue;
      fit_ = fit;
      found_.layout.separator = separator;
    }
    constexpr double kLeast = 0.2;  // of the fields in sight
    if (fit_.columns == 0 || fit_.score < (options_.separator ? 0 : kLeast * 0.5))
      return "no table of numbers was found in it; give a file with one row a line, its columns "
             "separated by semicolons, commas, tabs or blanks";
    found_.columns = fit_.columns;
    return std::nullopt;
  }

  /// Index of the first row.
  std::optional<std::size_t> find_first_row() {
    std::size_t run = 0;  // of lines that are rows, whole or ragged
    std::optional<std::size_t> begin;
    for (std::size_t i = 0; i < records_.size() && !(run >= 3 && begin); ++i) {
      if (is_comment(i)) continue;
      split(i);
      const RecordKinds kinds = kinds_of(fields_);
      const bool is_row = kinds.numbers > 0 && kinds.values() >= 0.6 * fit_.typical_values &&
                          !is_unit_line(fields_);
      run = is_row ? run + 1 : 0;
      if (!is_row) begin.reset();
      if (is_row && !begin && fields_.size() == found_.columns) begin = i;
    }
    if (!begin) return std::nullopt;
    found_.layout.first_line = records_[*begin].line;
    return begin;
  }

  void find_heading(std::size_t first_row) {
    TableLayout& layout = found_.layout;
    layout.headings.assign(found_.columns, "");
    std::optional<std::size_t> heading, units;
    for (std::size_t i = first_row; i-- > 0;) {
      if (is_comment(i)) continue;
      const std::vector<std::string> names =
          heading_fields(records_[i].text, layout.separator, found_.columns);
      const std::vector<std::string_view> views(names.begin(), names.end());
      if (!may_be_heading(views, found_.columns) &&
          !(views.size() == found_.columns && is_unit_line(views)))
        continue;
      if (!units && is_unit_line(views) && !heading) {
        units = i;
        layout.units = names;
        continue;
      }
      heading = i;
      layout.headings = names;
      break;
    }
    if (!heading && units) {  // names that are spelled like units
      heading = units;
      layout.headings = layout.units;
      layout.units.clear();
      units.reset();
    }
    if (!heading) {
      heading = comment_heading(first_row);
    }
    for (std::string& unit : layout.units) unit = std::string(without_brackets(unit));
    layout.has_heading = heading.has_value();
    for (std::size_t i = 0; i < first_row; ++i)
      if (i != heading && i != units)
        layout.titles.emplace_back(is_comment(i) ? comment_content(records_[i].text)
                                                 : trim(records_[i].text));
  }

  /// A separator at the end of every line makes no column.
  void drop_empty_end(std::size_t first_row) {
    TableLayout& layout = found_.layout;
    if (found_.columns < 3 || layout.separator == ' ' || !layout.headings.back().empty() ||
        !layout.has_heading)
      return;
    for (std::size_t i = first_row; i < records_.size(); ++i) {
      if (is_comment(i)) continue;
      split(i);
      if (fields_.size() == found_.columns && !fields_.back().empty()) return;
    }
    --found_.columns;
    layout.headings.pop_back();
    if (!layout.units.empty()) layout.units.pop_back();
  }

  /// Data error when both marks stand as decimal marks.
  std::optional<std::string> find_mark(std::size_t first_row) {
    TableLayout& layout = found_.layout;
    MarkEvidence evidence;
    for (std::size_t i = first_row; i < records_.size(); ++i) {
      if (is_comment(i)) continue;
      split(i);
      for (const std::string_view field : fields_) evidence.take(field);
    }
    if (options_.mark) {
      layout.mark = *options_.mark;
      return std::nullopt;
    }
    if (evidence.point > 0 && evidence.comma > 0 &&
        std::min(evidence.point, evidence.comma) * 50 > std::max(evidence.point, evidence.comma))
      return "its numbers have decimal points (" + std::to_string(evidence.point) +
             ") and decimal commas (" + std::to_string(evidence.comma) +
             "); say which with --decimal point or --decimal comma";
    layout.mark = evidence.comma > evidence.point ? DecimalMark::comma : DecimalMark::point;
    if (evidence.point + evidence.comma == 0 && evidence.open > 0 && layout.separator != ',') {
      layout.mark_is_open = true;
      layout.open_example = evidence.example;
      layout.mark =
          evidence.open_commas > evidence.open_points ? DecimalMark::comma : DecimalMark::point;
    } else if (evidence.point + evidence.comma == 0 && evidence.open_commas > 0) {
      layout.mark_is_open = true;
      layout.open_example = evidence.example;
    }
    return std::nullopt;
  }

  /// Decimal commas between commas: twice as many fields as names.
  [[nodiscard]] std::optional<std::string> commas_within(std::size_t first_row) const {
    if (found_.layout.separator != ',' || found_.layout.has_heading || first_row == 0)
      return std::nullopt;
    std::vector<std::string_view> names;
    std::vector<std::string> unquoted;
    for (std::size_t i = first_row; i-- > 0;) {
      split_record(records_[i].text, ',', names, unquoted);
      if (kinds_of(names).numbers == 0 && 2 * names.size() == found_.columns)
        return "its heading names " + std::to_string(names.size()) + " columns, its rows have " +
               std::to_string(found_.columns) +
               " fields: decimal commas cannot be told from separating ones; export it with "
               "semicolons or decimal points" +
               (names.size() == 1 ? ", or say --separator none --decimal comma" : "");
    }
    return std::nullopt;
  }

  [[nodiscard]] FoundLayout take() { return std::move(found_); }

 private:
  [[nodiscard]] bool is_comment(std::size_t i) const {
    return is_table_comment(records_[i].text, found_.layout.separator);
  }
  void split(std::size_t i) {
    split_row(records_[i].text, found_.layout.separator, found_.columns, fields_, unquoted_);
  }
  /// A heading behind a comment sign, right above the rows.
  std::optional<std::size_t> comment_heading(std::size_t first_row) {
    if (first_row == 0 || !is_comment(first_row - 1)) return std::nullopt;
    const std::string_view text = comment_content(records_[first_row - 1].text);
    const auto names = heading_fields(text, found_.layout.separator, found_.columns);
    const std::vector<std::string_view> views(names.begin(), names.end());
    if (!may_be_heading(views, found_.columns)) return std::nullopt;
    found_.layout.headings = names;
    return first_row - 1;
  }

  const std::vector<TableRecord>& records_;
  const TableOptions& options_;
  FoundLayout found_;
  SeparatorFit fit_;
  std::vector<std::string_view> fields_;
  std::vector<std::string> unquoted_;
};

}  // namespace

bool is_table_comment(std::string_view record, char separator) {
  const std::size_t at = record.find_first_not_of(separator == '\t' ? " " : " \t");
  if (at == std::string_view::npos) return false;
  record.remove_prefix(at);
  // A unit or a name that stands alone in its field: "%;mm", "#;Time".
  if (separator != ' ' && record.size() > 1 && record[1] == separator) return false;
  return record.starts_with('#') || record.starts_with('%') || record.starts_with("//") ||
         (separator != ';' && record.starts_with(';'));
}

bool is_table_value(std::string_view field) {
  for (const DecimalMark mark : {DecimalMark::point, DecimalMark::comma})
    if (table_number(field, mark).state != TableNumber::State::text)
      return field.find(' ') == std::string_view::npos;
  return time_stamp_from(field).has_value();
}

void split_row(std::string_view record, char separator, std::size_t columns,
               std::vector<std::string_view>& fields, std::vector<std::string>& unquoted) {
  split_record(record, separator, fields, unquoted);
  if (fields.size() == columns + 1 && fields.back().empty()) fields.pop_back();
}

Expected<FoundLayout> find_layout(const std::vector<TableRecord>& records,
                                  const TableOptions& options, const std::string& name) {
  LayoutFinder finder(records, options);
  if (const auto fault = finder.find_separator()) return data_error(name + ": " + *fault);
  const auto first_row = finder.find_first_row();
  if (!first_row)
    return data_error(name +
                      ": no row of numbers was found in its first lines; give a file with one row "
                      "a line");
  finder.find_heading(*first_row);
  finder.drop_empty_end(*first_row);
  if (const auto fault = finder.commas_within(*first_row)) return data_error(name + ": " + *fault);
  if (const auto fault = finder.find_mark(*first_row)) return data_error(name + ": " + *fault);
  return finder.take();
}

}  // namespace servosense::detail
