#include "servosense/io/line_reader.hpp"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>
#include <utility>

#include "byte_order_mark.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr std::size_t kBlock = std::size_t{1} << 16U;

}  // namespace

Expected<std::unique_ptr<std::istream>> open_for_reading(const std::string& path) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored))
    return device_error(printable(path, 400) + ": is a folder; give the path of a file");
  errno = 0;
  auto file = std::make_unique<std::ifstream>(path, std::ios::binary);
  if (!*file) {
    const std::string reason =
        errno != 0 ? std::generic_category().message(errno) : "unknown reason";
    return device_error(printable(path, 400) + ": cannot be opened (" + reason +
                        "); check the path and the right to read it");
  }
  return std::unique_ptr<std::istream>(std::move(file));
}

LineReader::LineReader(std::unique_ptr<std::istream> stream, std::string name)
    : stream_(std::move(stream)), name_(printable(name, 400)) {}

Error LineReader::error_here(std::string_view what) const {
  return data_error(name_ + ":" + std::to_string(line_number_) + ": " + std::string(what));
}

bool LineReader::refill() {
  if (begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  if (buffer_.size() < end_ + kBlock) buffer_.resize(end_ + kBlock);
  stream_->read(buffer_.data() + end_, static_cast<std::streamsize>(kBlock));
  const auto got = static_cast<std::size_t>(stream_->gcount());
  end_ += got;
  return got > 0;
}

Expected<bool> LineReader::next(std::string_view& line) {
  std::size_t searched = 0;
  std::size_t length = 0;
  std::size_t line_end = 0;
  for (;;) {
    const char* const unread = buffer_.data() + begin_;
    const void* const found = std::memchr(unread + searched, '\n', end_ - begin_ - searched);
    searched = end_ - begin_;
    length = found ? static_cast<std::size_t>(static_cast<const char*>(found) - unread) : searched;
    line_end = found ? length + 1 : length;
    if (length > kLongestLine) {
      ++line_number_;
      return error_here("the line is longer than 1 MiB; give a text file with one record a line");
    }
    if (found) break;
    if (refill()) continue;
    if (stream_->bad())
      return device_error(name_ + ": reading failed after line " + std::to_string(line_number_) +
                          "; check the disk or the connection");
    if (searched == 0) return false;
    break;
  }
  line = {buffer_.data() + begin_, length};
  begin_ += line_end;
  bytes_consumed_ += line_end;
  if (++line_number_ == 1 && line.starts_with(kByteOrderMark))
    line.remove_prefix(kByteOrderMark.size());
  if (line.ends_with('\r')) line.remove_suffix(1);
  return true;
}

}  // namespace servosense
