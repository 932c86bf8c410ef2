// Tables as controls, oscilloscopes and spreadsheets export them: any separator, either decimal
// mark, UTF-8, UTF-16 or Latin-1, title lines, units in a second heading line, or no heading.
//
// The layout is found in the first lines (2000 records, 4 MiB) and nowhere guessed: a decimal mark
// that could be the other one is said to be so. Rows are read one by one in constant memory, as
// often as wanted.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

enum class DecimalMark : std::uint8_t { point, comma };

/// A field as a number.
struct TableNumber {
  enum class State : std::uint8_t {
    value,
    empty,    ///< nothing stands there
    invalid,  ///< NaN, n/a, ---: no value
    text      ///< something else
  };
  State state = State::empty;
  double value = 0;
};
/// Reads a field: thousands may be separated by the other mark, an apostrophe or a blank.
[[nodiscard]] TableNumber table_number(std::string_view field, DecimalMark mark);
/// The number without its thousands marks and with a decimal point, for exact reading; empty when
/// it is none.
[[nodiscard]] std::string plain_number(std::string_view field, DecimalMark mark);

struct TableLayout {
  std::string encoding;  ///< "UTF-8", "UTF-16 LE", "UTF-16 BE", "Latin-1"
  char separator = ',';  ///< ' ' any blanks, '\0' one column
  DecimalMark mark = DecimalMark::point;
  /// Every number with a mark could also be read with the other mark: "1,234".
  bool mark_is_open = false;
  std::string open_example;  ///< such a number
  bool has_heading = false;
  std::vector<std::string> headings;  ///< one a column; "" where none stands
  std::vector<std::string> units;     ///< of a line of units, else empty
  std::vector<std::string> titles;    ///< lines above the heading
  std::size_t first_line = 0;         ///< of the first row, from 1
};
/// "semicolons", "blanks"
[[nodiscard]] std::string separator_name(char separator);

/// What the reader is told instead of finding it.
struct TableOptions {
  std::optional<char> separator;
  std::optional<DecimalMark> mark;
};

struct TableRow {
  std::vector<std::string_view> fields;  ///< one per column, trimmed; valid until the next row
  std::size_t line = 0;
};

class TableFile {
 public:
  /// Opens the file and finds its layout. Data error when there is no table in it. A binary matrix
  /// (binary_matrix.hpp) is read as its text; the options are not for it.
  static Expected<TableFile> open(const std::string& path, const TableOptions& options = {});
  /// The same from a stream that can be rewound.
  static Expected<TableFile> from_stream(std::unique_ptr<std::istream> stream, std::string name,
                                         const TableOptions& options = {});
  TableFile(TableFile&&) noexcept;
  TableFile& operator=(TableFile&&) noexcept;
  ~TableFile();

  [[nodiscard]] const TableLayout& layout() const;
  [[nodiscard]] const std::string& name() const;
  /// Reads the next row; false at the end. Lines that are no row - comments, blank ones - are
  /// passed over. A row with another number of fields is left out and counted; data error when that
  /// is more than ten and one in a thousand.
  Expected<bool> next(TableRow& row);
  /// To the first row again.
  Expected<Done> rewind();

  /// Rows left out since the first row, and where the first one is.
  struct Ragged {
    std::size_t count = 0;
    std::size_t line = 0;
    std::size_t fields = 0;
  };
  [[nodiscard]] const Ragged& ragged() const;
  /// Share of the file's bytes already read, 0..1; 0 while unknown.
  [[nodiscard]] double progress() const;
  /// "FILE:LINE: what"
  [[nodiscard]] Error error_at(std::size_t line, std::string_view what) const;

 private:
  struct Content;
  explicit TableFile(std::unique_ptr<Content> content);
  std::unique_ptr<Content> content_;
};

}  // namespace servosense
