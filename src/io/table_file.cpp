#include "servosense/io/table_file.hpp"

#include <filesystem>
#include <istream>
#include <utility>

#include "servosense/io/binary_matrix.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"
#include "table_layout.hpp"
#include "table_text.hpp"

namespace servosense {

std::string separator_name(char separator) {
  switch (separator) {
    case ';':
      return "semicolons";
    case ',':
      return "commas";
    case '\t':
      return "tabs";
    case ' ':
      return "blanks";
    case '\0':
      return "nothing, one column";
    default:
      return "'" + std::string(1, separator) + "'";
  }
}

struct TableFile::Content {
  Content(std::unique_ptr<std::istream> stream, std::string name)
      : text(std::move(stream), std::move(name)) {}

  detail::TableText text;
  TableLayout layout;
  std::size_t columns = 0;
  std::uint64_t size_bytes = 0;  // 0: unknown
  std::string record;
  std::vector<std::string> unquoted;
  std::size_t rows = 0;
  Ragged ragged;

  Expected<Done> find_layout(const TableOptions& options);
  Expected<bool> next(TableRow& row);
  /// A heading that is written again where a recording was continued.
  [[nodiscard]] bool is_heading_again(const std::vector<std::string_view>& fields) const {
    return layout.has_heading && fields.size() == columns &&
           std::equal(fields.begin(), fields.end(), layout.headings.begin());
  }
};

Expected<Done> TableFile::Content::find_layout(const TableOptions& options) {
  constexpr std::size_t kMostRecords = 2000;
  constexpr std::size_t kMostBytes = std::size_t{1} << 22U;
  std::vector<detail::TableRecord> records;
  std::size_t bytes = 0;
  while (records.size() < kMostRecords && bytes < kMostBytes) {
    const auto more = text.next(record);
    if (!more) return more.error();
    if (!*more) break;
    bytes += record.size();
    if (!trim(record).empty()) records.push_back({record, text.line()});
  }
  if (records.empty())
    return data_error(text.name() + ": the file is empty; give one with rows of numbers");
  auto found = detail::find_layout(records, options, text.name());
  if (!found) return found.error();
  layout = std::move(found->layout);
  layout.encoding = text.encoding();
  columns = found->columns;
  return Done{};
}

Expected<bool> TableFile::Content::next(TableRow& row) {
  constexpr std::size_t kFewRagged = 10;
  constexpr std::size_t kRowsPerRagged = 1000;
  for (;;) {
    const auto more = text.next(record);
    if (!more || !*more) return more;
    if (text.line() < layout.first_line || trim(record).empty() ||
        detail::is_table_comment(record, layout.separator))
      continue;
    detail::split_row(record, layout.separator, columns, row.fields, unquoted);
    if (row.fields.size() == columns && !is_heading_again(row.fields)) {
      ++rows;
      row.line = text.line();
      return true;
    }
    if (ragged.count++ == 0) {
      ragged.line = text.line();
      ragged.fields = row.fields.size();
    }
    if (ragged.count > kFewRagged && ragged.count * kRowsPerRagged > rows)
      return text.error_at(ragged.line,
                           "expected " + std::to_string(columns) + " fields, found " +
                               std::to_string(ragged.fields) + ", and so in " +
                               std::to_string(ragged.count) + " rows up to line " +
                               std::to_string(text.line()) +
                               "; export the table with the same columns in every row, or say "
                               "--separator if it was read wrongly (found: " +
                               separator_name(layout.separator) + ")");
  }
}

TableFile::TableFile(std::unique_ptr<Content> content) : content_(std::move(content)) {}
TableFile::TableFile(TableFile&&) noexcept = default;
TableFile& TableFile::operator=(TableFile&&) noexcept = default;
TableFile::~TableFile() = default;

Expected<TableFile> TableFile::from_stream(std::unique_ptr<std::istream> stream, std::string name,
                                           const TableOptions& options) {
  auto content = std::make_unique<Content>(std::move(stream), std::move(name));
  if (auto done = content->find_layout(options); !done) return done.error();
  TableFile file(std::move(content));
  if (auto done = file.rewind(); !done) return done.error();
  return file;
}

Expected<TableFile> TableFile::open(const std::string& path, const TableOptions& options) {
  if (BinaryMatrix::is_matrix(path)) {
    auto matrix = BinaryMatrix::open(path);
    if (!matrix) return matrix.error();
    auto file = from_stream(text_of(std::move(*matrix)), path, {});
    if (file) file->content_->layout.encoding = "32-bit floats, here as text";
    return file;
  }
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  auto file = from_stream(std::move(*stream), path, options);
  if (!file) return file;
  std::error_code none;
  const auto size = std::filesystem::file_size(path, none);
  if (!none) file->content_->size_bytes = size;
  return file;
}

const TableLayout& TableFile::layout() const { return content_->layout; }
const std::string& TableFile::name() const { return content_->text.name(); }
Expected<bool> TableFile::next(TableRow& row) { return content_->next(row); }

Expected<Done> TableFile::rewind() {
  content_->rows = 0;
  content_->ragged = {};
  return content_->text.rewind();
}

const TableFile::Ragged& TableFile::ragged() const { return content_->ragged; }

double TableFile::progress() const {
  if (content_->size_bytes == 0) return 0;
  return static_cast<double>(content_->text.bytes_consumed()) /
         static_cast<double>(content_->size_bytes);
}

Error TableFile::error_at(std::size_t line, std::string_view what) const {
  return content_->text.error_at(line, what);
}

}  // namespace servosense
