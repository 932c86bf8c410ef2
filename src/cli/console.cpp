#include "console.hpp"

#include <unistd.h>

#include <cstdio>
#include <utility>

namespace servosense::cli {

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

int fail(const Error& error) {
  std::fprintf(stderr, "servosense: %s\n", error.sentence.c_str());
  return exit_status(error);
}

Progress::Progress(std::string what, bool quiet)
    : what_(std::move(what)), visible_(!quiet && isatty(STDERR_FILENO) != 0) {}

Progress::~Progress() {
  if (visible_ && last_ >= 0) std::fprintf(stderr, "\r\033[K");
}

void Progress::show(double share) {
  const int percent = static_cast<int>(share * 100);
  if (!visible_ || percent == last_) return;
  last_ = percent;
  std::fprintf(stderr, "\r%s %3d %%", what_.c_str(), percent);
}

}  // namespace servosense::cli
