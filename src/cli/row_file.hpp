// A table on disk, written row by row as its rows come.
#pragma once

#include <optional>
#include <string>
#include <utility>

#include "arguments.hpp"
#include "servosense/io/output_file.hpp"

namespace servosense::cli {

class RowFile {
 public:
  RowFile(OutputFile file, const std::string& header) : file_(std::move(file)), text_(header) {
    text_ += '\n';
  }
  /// Of --out; nothing if that is not given.
  static Expected<std::optional<RowFile>> asked(const Arguments& arguments,
                                                const std::string& header) {
    const auto path = arguments.value("--out");
    if (!path) return std::optional<RowFile>();
    auto file = OutputFile::open(*path);
    if (!file) return file.error();
    return std::optional<RowFile>(RowFile(std::move(*file), header));
  }
  /// Where the next row goes; end it with end_row().
  std::string& row() { return text_; }
  void end_row() {
    text_ += '\n';
    if (text_.size() > kChunk) write();
  }
  /// The first failure, if there was one.
  Expected<Done> finish() {
    write();
    if (failure_) return *failure_;
    return file_.commit();
  }

 private:
  static constexpr std::size_t kChunk = std::size_t{1} << 16U;
  void write() {
    if (!failure_)
      if (const auto done = file_.write(text_); !done) failure_ = done.error();
    text_.clear();
  }

  OutputFile file_;
  std::string text_;
  std::optional<Error> failure_;
};

}  // namespace servosense::cli
