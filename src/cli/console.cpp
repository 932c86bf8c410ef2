#include "console.hpp"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <iostream>
#include <sstream>
#include <utility>

#include "servosense/io/json.hpp"
#include "servosense/io/text.hpp"

namespace servosense::cli {
namespace {

bool json_errors = false;

/// Characters, where each is one column wide.
std::size_t columns_of(std::string_view text) {
  std::size_t n = 0;
  for (const char c : text) n += (static_cast<unsigned char>(c) & 0xC0U) != 0x80U ? 1 : 0;
  return n;
}

/// Where the last of the columns begins that two blanks or more set apart.
std::size_t last_column(const std::string& line, std::size_t most) {
  std::size_t at = std::min(line.find_first_not_of(' '), line.size());
  for (std::size_t gap = line.find("  ", at); gap < most; gap = line.find("  ", gap)) {
    gap = std::min(line.find_first_not_of(' ', gap), line.size());
    if (gap <= most) at = gap;
  }
  return at;
}

}  // namespace

std::string fitted(const std::string& line, std::size_t width) {
  const std::string indent(last_column(line, width / 2), ' ');
  std::string text, now;
  std::size_t from = 0;
  while (from < line.size()) {
    // Words with the blanks before them.
    const std::size_t word = std::min(line.find_first_not_of(' ', from), line.size());
    const std::size_t end = std::min(line.find(' ', word), line.size());
    if (columns_of(now) + columns_of(std::string_view(line).substr(from, end - from)) > width &&
        columns_of(now) > indent.size()) {
      text += now + '\n';
      now = indent;
      from = word;
    }
    now += line.substr(from, end - from);
    from = end;
  }
  return text + now;
}

std::string fitted_paragraphs(const std::string& text, std::size_t width) {
  std::istringstream lines(text);
  std::string all, paragraph;
  const auto flat = [](const std::string& line) { return !line.empty() && line[0] != ' '; };
  const auto end_paragraph = [&] {
    if (!paragraph.empty()) all += fitted(paragraph, width) + '\n';
    paragraph.clear();
  };
  for (std::string line; std::getline(lines, line);) {
    if (flat(line) && !paragraph.empty()) {
      paragraph += ' ' + line;
      continue;
    }
    end_paragraph();
    if (flat(line))
      paragraph = line;
    else
      all += fitted(line, width) + '\n';
  }
  end_paragraph();
  return all;
}

std::optional<std::size_t> terminal_width(std::FILE* stream) {
  winsize size{};
  if (isatty(fileno(stream)) == 0) return std::nullopt;
  if (ioctl(fileno(stream), TIOCGWINSZ, &size) != 0 || size.ws_col < 40) return 80;
  return size.ws_col;
}

void say(const char* format, ...) {
  static std::string begun;  // a line, up to its end
  va_list values;
  va_start(values, format);
  va_list again;
  va_copy(again, values);
  std::string text(static_cast<std::size_t>(std::max(0, std::vsnprintf(nullptr, 0, format, again))),
                   '\0');
  va_end(again);
  std::vsnprintf(text.data(), text.size() + 1, format, values);
  va_end(values);
  begun += text;
  const auto width = terminal_width(stdout);
  for (std::size_t end = begun.find('\n'); end != std::string::npos; end = begun.find('\n')) {
    const std::string line = printable(begun.substr(0, end), std::string::npos);
    std::printf("%s\n", (width ? fitted(line, *width) : line).c_str());
    begun.erase(0, end + 1);
  }
}

void note(const std::string& remark, bool quiet) {
  if (quiet) return;
  const std::string line = "servosense: note: " + printable(remark, std::string::npos);
  const auto width = terminal_width(stderr);
  std::fprintf(stderr, "%s\n", (width ? fitted(line, *width) : line).c_str());
}

int exit_status(const Error& error) {
  switch (error.kind) {
    case ErrorKind::usage:
      return 2;
    case ErrorKind::data:
      return 3;
    case ErrorKind::device:
      return 4;
  }
  return 3;
}

void errors_as_json(bool yes) { json_errors = yes; }

int complain(const Error& error) {
  std::fflush(stdout);  // it belongs behind the result
  std::istringstream sentences(error.sentence);
  for (std::string sentence; std::getline(sentences, sentence);)
    std::fprintf(stderr, "servosense: %s\n", printable(sentence, std::string::npos).c_str());
  return exit_status(error);
}

int fail(const Error& error) {
  complain(error);
  if (json_errors) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.key("error");
    json.begin_object();
    json.member("status", exit_status(error));
    json.member("message", error.sentence);
    json.end_object();
    json.end_object();
    std::cout << '\n';
  }
  return exit_status(error);
}

Progress::Progress(std::string what, bool quiet)
    : what_(std::move(what)), visible_(!quiet && isatty(STDERR_FILENO) != 0) {}

Progress::~Progress() {
  if (visible_ && !last_.empty()) std::fprintf(stderr, "\r\033[K");
}

void Progress::show(double share) {
  if (visible_) print(what_ + " " + std::to_string(static_cast<int>(share * 100)) + " %");
}

void Progress::show(const std::string& step, std::size_t done, std::size_t of) {
  if (!visible_) return;
  const auto seconds =
      std::chrono::duration_cast<std::chrono::seconds>(std::chrono::steady_clock::now() - begun_)
          .count();
  print(what_ + ": " + step + ", " + std::to_string(done) + " of " + std::to_string(of) + " (" +
        std::to_string(seconds) + " s)");
}

void Progress::print(const std::string& line) {
  const std::lock_guard lock(printing_);
  if (line == last_) return;
  last_ = line;
  // A line that runs over cannot be taken back.
  const std::string shown = fitted(printable(line, std::string::npos), *terminal_width(stderr) - 1);
  std::fprintf(stderr, "\r\033[K%s", shown.substr(0, shown.find('\n')).c_str());
}

}  // namespace servosense::cli
