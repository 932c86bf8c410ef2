// The text of a foreign table: its encoding, its lines, what stands between quotation marks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <istream>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense::detail {

/// Records as UTF-8: lines ended by LF, CR LF or CR, joined where a field in quotation marks has
/// line ends in it.
class TableText {
 public:
  static constexpr std::size_t kLongestRecord = std::size_t{1} << 20U;

  TableText(std::unique_ptr<std::istream> stream, std::string name);
  /// The next record; false at the end. Data error for binary content.
  Expected<bool> next(std::string& record);
  Expected<Done> rewind();

  [[nodiscard]] std::size_t line() const { return record_line_; }  ///< first line of the record
  [[nodiscard]] std::uint64_t bytes_consumed() const { return bytes_; }
  [[nodiscard]] std::string encoding() const;
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] Error error_at(std::size_t line, std::string_view what) const;

 private:
  enum class Encoding : std::uint8_t { bytes, utf16_le, utf16_be };
  void find_encoding();
  bool refill();
  bool unit(unsigned& code);
  Expected<bool> physical_line(std::string& line);
  Expected<bool> wide_line(std::string& line);

  std::unique_ptr<std::istream> stream_;
  std::string name_;
  std::string buffer_;
  std::size_t at_ = 0, end_ = 0;
  Encoding encoding_ = Encoding::bytes;
  bool latin1_ = false;
  bool after_cr_ = false;
  std::size_t line_ = 0, record_line_ = 0;
  std::uint64_t bytes_ = 0;
};

/// Whether a field in quotation marks is still open at the end of `text`.
[[nodiscard]] bool quotation_is_open(std::string_view text);

/// Fields of a record. Those in quotation marks are put into `unquoted` when a doubled mark has to
/// be taken out; all are trimmed.
void split_record(std::string_view record, char separator, std::vector<std::string_view>& fields,
                  std::vector<std::string>& unquoted);

}  // namespace servosense::detail
