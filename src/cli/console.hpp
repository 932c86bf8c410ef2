// What the program says on standard error: progress while it works, remarks, the one error
// sentence.
#pragma once

#include <string>

#include "servosense/core/expected.hpp"

namespace servosense::cli {

/// Exit status for an error.
int exit_status(const Error& error);
/// Prints the sentence and returns the exit status.
int fail(const Error& error);

/// A line that says how far the work is; silent unless standard error is a terminal.
class Progress {
 public:
  Progress(std::string what, bool quiet);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  /// `share` of the work done, 0..1. Cheap: prints only whole per cents.
  void show(double share);

 private:
  std::string what_;
  bool visible_;
  int last_ = -1;
};

}  // namespace servosense::cli
