// From a foreign table to a trace: what each of its columns becomes, what could not be decided, and
// the writing.
//
// A column is taken when its heading says of which drive, which quantity and in which unit, all
// words of it are known, no other column is the same, and its values are such as machines have. A
// unit that is missing may be settled by another column: a position and a speed of one drive agree
// by differentiation in one pair of units only; where the headings disagree with that, it is a
// question. Everything else is a question with the answer to type.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/core/units.hpp"
#include "servosense/io/import_map.hpp"
#include "servosense/io/quantity_range.hpp"
#include "servosense/io/table_file.hpp"

namespace servosense {

/// A column of the foreign table.
struct ImportColumn {
  std::size_t number = 0;  ///< from 1
  std::string heading;     ///< as it stands in the file
  bool is_time = false;
  bool is_open = false;            ///< there is a question on it
  std::optional<Signal> signal;    ///< what it becomes; nothing: left out, or an open question
  std::string unit;                ///< as people write it; empty: none, or not known
  double factor = 1;               ///< of its values to those of the trace
  std::string reason;              ///< why it is left out, or by what its unit is known
  double least = 0, greatest = 0;  ///< after conversion; NaN without values
  double missing_share = 0;        ///< of the rows
  std::vector<std::string> first;  ///< first fields, as they stand
};

/// How the time of a row is read.
struct ImportTime {
  enum class Source : std::uint8_t { none, rate, number, stamp };
  Source source = Source::none;
  std::size_t column = 0;                  ///< index
  std::optional<std::size_t> date_column;  ///< beside a clock time
  double rate_hz = 0;
  int exponent = 0;           ///< of ten: a unit of the column in seconds,
  int multiple = 1;           ///< times this: 60 of minutes
  bool from_first = false;    ///< the first time is taken off
  Nanoseconds origin_ns = 0;  ///< that time
  std::string origin;         ///< the same as it is written to the trace
};

struct ImportPlan {
  std::vector<ImportColumn> columns;
  ImportTime time;
  std::vector<std::string> questions;  ///< what could not be decided, and the option that answers
  std::vector<std::string> remarks;
  std::size_t rows = 0;  ///< of the table
  double period_s = 0;   ///< median; NaN when the time is not known
  /// Rows that `where` does not take: from and to, both among them, as the time column counts.
  std::vector<std::pair<Nanoseconds, Nanoseconds>> without;
  ImportMap map;  ///< gives the same plan again
};

using ImportProgress = std::function<void(double share)>;

/// Reads the whole table once, and once more for `where`, which is asked when no question is open.
Expected<ImportPlan> plan_import(TableFile& file, const ImportMap& answers,
                                 const ImportProgress& progress = {});
/// Writes the trace of a plan without questions; how many rows. Usage error when it has some.
Expected<std::size_t> write_import(TableFile& file, const ImportPlan& plan, const std::string& out,
                                   const ImportProgress& progress = {});

}  // namespace servosense
