// How a foreign table is laid out, from its first records.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/table_file.hpp"

namespace servosense::detail {

/// What the numbers say of the decimal mark.
struct MarkEvidence {
  std::size_t point = 0;  ///< numbers that have a decimal point for certain
  std::size_t comma = 0;
  std::size_t open = 0;  ///< either: "1,234"
  std::size_t open_points = 0, open_commas = 0;
  std::string example;  ///< the first that is open
  void take(std::string_view field);
};

struct TableRecord {
  std::string text;
  std::size_t line = 0;
};

/// "# text", "% text", "// text"; of files that are not separated by semicolons also "; text".
[[nodiscard]] bool is_table_comment(std::string_view record, char separator);
/// Number, time stamp, or word for a missing value, with either decimal mark.
[[nodiscard]] bool is_table_value(std::string_view field);

/// Fields of a record, with the one behind a trailing separator dropped when `columns` are wanted.
void split_row(std::string_view record, char separator, std::size_t columns,
               std::vector<std::string_view>& fields, std::vector<std::string>& unquoted);

struct FoundLayout {
  TableLayout layout;
  std::size_t columns = 0;
};
/// Data error, without place, when the records hold no table.
Expected<FoundLayout> find_layout(const std::vector<TableRecord>& records,
                                  const TableOptions& options, const std::string& name);

}  // namespace servosense::detail
