// The project's whole test apparatus: checks that count, tolerances, figures, recorded sets.
// A test is a program: it makes its checks, prints what failed and ends with `return
// check::done();`
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

namespace check {

inline int checks = 0;
inline int failures = 0;

inline std::ostream& fail(const char* file, int line) {
  ++failures;
  return std::cout << file << ':' << line << ": ";
}

inline void that(bool ok, const char* text, const char* file, int line) {
  ++checks;
  if (!ok) fail(file, line) << "failed: " << text << '\n';
}

/// |value - expected| <= tolerance; NaN never passes.
inline void near(double value, double expected, double tolerance, const char* text,
                 const char* file, int line) {
  ++checks;
  if (!(std::abs(value - expected) <= tolerance))
    fail(file, line) << text << " = " << value << ", expected " << expected << " +- " << tolerance
                     << '\n';
}

/// low <= value <= high, so that an unexplained improvement is looked at too.
inline void between(double value, double low, double high, const char* text, const char* file,
                    int line) {
  ++checks;
  if (!(value >= low && value <= high))
    fail(file, line) << text << " = " << value << ", expected within [" << low << ", " << high
                     << "]\n";
}

inline void equal_text(const std::string& value, const std::string& expected, const char* file,
                       int line) {
  ++checks;
  if (value != expected)
    fail(file, line) << "got      \"" << value << "\"\n    expected \"" << expected << "\"\n";
}

/// Prints a figure that a reader of the log wants to see beside the checks.
inline void figure(const std::string& name, double value, const char* unit = "") {
  std::printf("  %-58s %12.6g %s\n", name.c_str(), value, unit);
}

/// A recorded set that may not be shipped: its folder, or "" after saying aloud that it is absent.
inline std::string outside_data(const std::string& set) {
  const char* root = std::getenv("SERVOSENSE_DATA");
  const std::string folder = (root ? std::string(root) : std::string("../shared/data")) + "/" + set;
  if (std::ifstream(folder + "/README.md")) return folder;
  std::cout << "SKIPPED: recorded data set '" << set << "' is not at " << folder
            << " (set SERVOSENSE_DATA to the folder that holds the sets)\n";
  return {};
}

/// Whether a test was asked for all that it has, which takes too long for every change.
inline bool nightly(int argc, char** argv) {
  return argc > 1 && std::string(argv[1]) == "--nightly";
}

/// Exit status for CTest: 0 passed, 1 failed, 77 skipped (no check could be made).
inline int done() {
  if (checks == 0) {
    std::cout << "no check was made\n";
    return 77;
  }
  std::cout << checks << " checks, " << failures << " failed\n";
  return failures == 0 ? 0 : 1;
}

}  // namespace check

#define CHECK(expression) \
  check::that(static_cast<bool>(expression), #expression, __FILE__, __LINE__)
#define CHECK_NEAR(value, expected, tolerance) \
  check::near((value), (expected), (tolerance), #value, __FILE__, __LINE__)
#define CHECK_BETWEEN(value, low, high) \
  check::between((value), (low), (high), #value, __FILE__, __LINE__)
#define CHECK_TEXT(value, expected) check::equal_text((value), (expected), __FILE__, __LINE__)
