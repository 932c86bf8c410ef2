// What the program says: the result on standard output; on standard error progress while it works,
// remarks, the one error sentence.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdio>
#include <mutex>
#include <optional>
#include <string>

#include "servosense/core/expected.hpp"

namespace servosense::cli {

/// The result for people, as printf; what a terminal would obey or cannot show becomes \xNN. On a
/// terminal long lines are broken between words, the rest below the line's last column.
[[gnu::format(printf, 1, 2)]] void say(const char* format, ...);
/// `line` so broken, for a terminal of `width` columns.
std::string fitted(const std::string& line, std::size_t width);
/// Text of many lines likewise; lines that follow one another without an indent are one paragraph.
std::string fitted_paragraphs(const std::string& text, std::size_t width);
/// Columns of the terminal that `stream` is; nothing for a file or a pipe.
std::optional<std::size_t> terminal_width(std::FILE* stream);
/// A remark on standard error, unless `quiet`.
void note(const std::string& remark, bool quiet = false);

/// Exit status for an error.
int exit_status(const Error& error);
/// With --json an error is a JSON object on standard output, too.
void errors_as_json(bool yes);
/// Prints the sentence, one of several a line, and returns the exit status.
int fail(const Error& error);
/// The same beside a result: what standard output says stays one JSON object.
int complain(const Error& error);

/// A line that says how far the work is; silent unless standard error is a terminal. show() may be
/// called from any thread.
class Progress {
 public:
  Progress(std::string what, bool quiet);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  /// `share` of the work done, 0..1. Cheap: prints only whole per cents.
  void show(double share);
  /// The same of a step, where nobody knows how many steps will follow: adds the time so far.
  void show(const std::string& step, std::size_t done, std::size_t of);

 private:
  void print(const std::string& line);

  std::string what_;
  bool visible_;
  std::chrono::steady_clock::time_point begun_ = std::chrono::steady_clock::now();
  std::mutex printing_;
  std::string last_;
};

}  // namespace servosense::cli
