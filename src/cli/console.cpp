#include "console.hpp"

#include <unistd.h>

#include <cstdio>
#include <iostream>
#include <sstream>
#include <utility>

#include "servosense/io/json.hpp"
#include "servosense/io/text.hpp"

namespace servosense::cli {
namespace {

bool json_errors = false;

}  // namespace

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
  std::fprintf(stderr, "\r\033[K%s", line.c_str());
}

}  // namespace servosense::cli
