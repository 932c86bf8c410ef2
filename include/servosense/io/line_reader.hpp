// Lines of a text file of any length, in constant memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <istream>
#include <memory>
#include <string>
#include <string_view>

#include "servosense/core/expected.hpp"

namespace servosense {

/// Opens a file for reading. Device error for one that is absent, a folder, or not readable.
Expected<std::unique_ptr<std::istream>> open_for_reading(const std::string& path);

/// Splits a stream into lines. LF and CRLF both end a line, a last line may go without, a UTF-8
/// byte order mark at the start is dropped. Holds one line and one block (64 KiB) at a time.
class LineReader {
 public:
  /// A longer line is taken for a binary file [bytes].
  static constexpr std::size_t kLongestLine = std::size_t{1} << 20U;

  /// `name` stands for the file in error sentences.
  LineReader(std::unique_ptr<std::istream> stream, std::string name);

  /// Puts the next line, without its end, into `line`, where it stays valid until the next call;
  /// false at the end. Data error for a line beyond kLongestLine, device error if reading fails.
  Expected<bool> next(std::string_view& line);

  /// Number of the line that next() gave last, from 1.
  [[nodiscard]] std::size_t line_number() const { return line_number_; }
  [[nodiscard]] std::uint64_t bytes_consumed() const { return bytes_consumed_; }
  [[nodiscard]] const std::string& name() const { return name_; }
  /// "FILE:LINE: what"
  [[nodiscard]] Error error_here(std::string_view what) const;

 private:
  bool refill();

  std::unique_ptr<std::istream> stream_;
  std::string name_;
  std::string buffer_;
  std::size_t begin_ = 0;  // unread bytes are buffer_[begin_, end_)
  std::size_t end_ = 0;
  std::size_t line_number_ = 0;
  std::uint64_t bytes_consumed_ = 0;
};

}  // namespace servosense
