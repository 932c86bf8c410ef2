// The corpus of malformed files: tests/data/malformed/<kind>/, with what each sentence must say in
// expected.txt (file | line | fragment | remedy).
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/core/expected.hpp"

namespace malformed {

struct Case {
  std::string path, line, fragment, remedy;
};

inline std::vector<Case> cases(const std::string& kind) {
  const std::string folder = "tests/data/malformed/" + kind + "/";
  std::ifstream in(folder + "expected.txt");
  std::vector<Case> all;
  for (std::string row; std::getline(in, row);) {
    if (row.empty() || row[0] == '#') continue;
    std::vector<std::string> parts;
    for (std::size_t at = 0; at != std::string::npos;) {
      const std::size_t next = row.find(" | ", at);
      parts.push_back(row.substr(at, next == std::string::npos ? next : next - at));
      at = next == std::string::npos ? next : next + 3;
    }
    CHECK(parts.size() == 4);
    if (parts.size() == 4) all.push_back({folder + parts[0], parts[1], parts[2], parts[3]});
  }
  return all;
}

/// `error_of(path)` gives the error a reader answers with, or an empty sentence for none. Every
/// file of the folder must be in the table, and every sentence must be one line, begin with file
/// and line, and hold both fragments.
template <typename ErrorOf>
void check_all(const std::string& kind, std::size_t at_least, ErrorOf error_of) {
  const std::vector<Case> all = cases(kind);
  CHECK(all.size() >= at_least);
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator("tests/data/malformed/" + kind))
    files += entry.path().filename() != "expected.txt" ? 1U : 0U;
  CHECK(files == all.size());

  for (const Case& c : all) {
    const servosense::Error error = error_of(c.path);
    const std::string& sentence = error.sentence;
    const bool good = error.kind == servosense::ErrorKind::data &&
                      sentence.starts_with(c.path + ":" + c.line + ": ") &&
                      sentence.find(c.fragment) != std::string::npos &&
                      sentence.find(c.remedy) != std::string::npos &&
                      sentence.find_first_of("\r\n") == std::string::npos && sentence.size() < 400;
    ++check::checks;
    if (!good)
      check::fail(__FILE__, __LINE__)
          << c.path << ": got \"" << sentence << "\"\n    expected line " << c.line << ", \""
          << c.fragment << "\", \"" << c.remedy << "\"\n";
  }
}

}  // namespace malformed
