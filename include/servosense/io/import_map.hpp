// Which column of a foreign table becomes which column of a trace: as people type it and as a file
// that serves the next table of the same layout.
//
//   # map of servosense import, made from drive.csv
//   separator = ;
//   decimal = comma
//   t_s = Zeit [ms] : ms
//   x.current_A = Strom X : A
//   - = Strom Y
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/io/table_file.hpp"

namespace servosense {

/// `NEW=OLD[:UNIT]`. What of `from` is the heading and what the unit, the headings of the file say.
struct ImportEntry {
  std::string to;       ///< a trace column, t_s, or "-": left out
  std::string from;     ///< OLD or OLD:UNIT; OLD may be #3, the third column
  bool in_map = false;  ///< stands in a map file: a heading that is missing is the table's fault
};
/// Usage error when NEW is no trace column, naming the nearest one.
Expected<ImportEntry> import_entry_from(std::string_view text);

/// Rows to be taken: those in which a column has this value, away from any other row.
struct ImportWhere {
  std::string column;  ///< heading as for ImportEntry, or #3
  double value = 0;
  double apart_s = 0;  ///< least distance from a row that has another value
};
/// `OLD=VALUE`, the value a number. Usage error otherwise.
Expected<ImportWhere> import_where_from(std::string_view text);

struct ImportMap {
  std::vector<ImportEntry> entries;
  std::optional<char> separator;
  std::optional<DecimalMark> mark;
  std::optional<double> rate_hz;  ///< of rows, for a table without time
  bool only = false;              ///< columns without an entry are left out
  std::optional<ImportWhere> where;
};

/// ";", "semicolon", "tab", "blank", "none"
Expected<char> separator_from(std::string_view text);
/// "point", "comma"
Expected<DecimalMark> decimal_mark_from(std::string_view text);

/// Data error naming file and line.
Expected<ImportMap> read_import_map(const std::string& path);
[[nodiscard]] std::string import_map_text(const ImportMap& map, std::string_view source);
/// What `flags` say goes before what `map` says.
[[nodiscard]] ImportMap overridden(ImportMap map, const ImportMap& flags);

}  // namespace servosense
