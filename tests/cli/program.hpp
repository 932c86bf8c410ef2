// Running the program as a user does, and reading what it says: exit status, both streams, JSON.
// Its path is in SERVOSENSE_PROGRAM.
#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"

namespace program_test {

namespace fs = std::filesystem;

// ---- running the program -----------------------------------------------------------------------

inline const char* program = nullptr;
inline fs::path folder;

inline std::string content(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

inline void put(const std::string& name, const std::string& text) {
  std::ofstream(folder / name, std::ios::binary) << text;
}

inline bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

struct Outcome {
  std::string command, out, err;
  int status = -1;
};

// The program runs in the folder of the test, so that files go by their bare names.
inline Outcome run(const std::string& arguments) {
  Outcome o;
  o.command = "servosense " + arguments;
  const std::string line = "cd '" + folder.string() + "' && '" + program + "' " + arguments +
                           " > out.txt 2> err.txt < /dev/null";
  const int raw = std::system(line.c_str());
  o.status = WIFEXITED(raw) ? WEXITSTATUS(raw) : -1;
  o.out = content(folder / "out.txt");
  o.err = content(folder / "err.txt");
  return o;
}

inline void that(bool ok, const Outcome& o, const std::string& what, int line) {
  check::that(ok, (o.command + ": " + what).c_str(), __FILE__, line);
  if (!ok)
    std::cout << "  status " << o.status << "\n  out: " << o.out.substr(0, 400)
              << "\n  err: " << o.err.substr(0, 400) << '\n';
}

// One sentence, on one line, beginning with the program's name.
inline bool one_sentence(const std::string& err) {
  return err.starts_with("servosense: ") && std::count(err.begin(), err.end(), '\n') == 1 &&
         err.back() == '\n';
}

inline std::vector<std::string> lines(const std::string& text) {
  std::vector<std::string> all;
  std::stringstream in(text);
  for (std::string line; std::getline(in, line);) all.push_back(line);
  return all;
}

// ---- JSON, read strictly (RFC 8259) ------------------------------------------------------------

// Scalars as their spelling (texts without quotes), by path: "events.0.state".
class Json {
 public:
  explicit Json(const std::string& text) : at_(text.data()), end_(text.data() + text.size()) {
    value("");
    blanks();
    ok = ok && at_ == end_;
  }
  bool ok = true;
  bool object = false;  // the whole of it is one
  std::map<std::string, std::string> scalars;
  std::map<std::string, std::size_t> sizes;  // of arrays and objects

  [[nodiscard]] std::string text(const std::string& path) const {
    const auto found = scalars.find(path);
    return found == scalars.end() ? "(absent)" : found->second;
  }
  [[nodiscard]] double number(const std::string& path) const {
    const auto found = scalars.find(path);
    return found == scalars.end() ? std::numeric_limits<double>::quiet_NaN()
                                  : std::strtod(found->second.c_str(), nullptr);
  }

 private:
  void blanks() {
    while (at_ != end_ && (*at_ == ' ' || *at_ == '\n' || *at_ == '\t' || *at_ == '\r')) ++at_;
  }
  bool take(char c) {
    blanks();
    if (at_ == end_ || *at_ != c) return false;
    ++at_;
    return true;
  }
  void value(const std::string& path) {
    blanks();
    if (!ok || at_ == end_) {
      ok = false;
    } else if (*at_ == '{') {
      if (path.empty()) object = true;
      group(path, '}', true);
    } else if (*at_ == '[') {
      group(path, ']', false);
    } else if (*at_ == '"') {
      scalars[path] = string();
    } else {
      std::string word;
      while (at_ != end_ && (std::isalnum(static_cast<unsigned char>(*at_)) || *at_ == '-' ||
                             *at_ == '+' || *at_ == '.'))
        word += *at_++;
      char* stop = nullptr;
      std::strtod(word.c_str(), &stop);
      const bool numeric = !word.empty() && *stop == '\0' &&
                           (std::isdigit(static_cast<unsigned char>(word[0])) || word[0] == '-') &&
                           !contains(word, "nan") && !contains(word, "inf");
      ok = ok && (numeric || word == "true" || word == "false" || word == "null");
      scalars[path] = word;
    }
  }
  void group(const std::string& path, char closing, bool named) {
    ++at_;
    std::size_t n = 0;
    for (bool more = !take(closing); ok && more;) {
      std::string name = std::to_string(n++);
      blanks();
      if (named) {
        ok = at_ != end_ && *at_ == '"';
        if (ok) name = string();
        ok = ok && take(':');
      }
      const std::string inner = path.empty() ? name : path + "." + name;
      ok = ok && !scalars.contains(inner) && !sizes.contains(inner);  // a key twice
      value(inner);
      more = take(',');
      if (!more) ok = ok && take(closing);
    }
    sizes[path] = n;
  }
  std::string string() {
    std::string text;
    for (++at_; at_ != end_ && *at_ != '"'; ++at_) {
      ok = ok && static_cast<unsigned char>(*at_) >= 0x20;
      if (*at_ == '\\' && ++at_ == end_) break;
      text += *at_;
    }
    if (at_ == end_)
      ok = false;
    else
      ++at_;
    return text;
  }
  const char* at_;
  const char* end_;
};

// A refusal: status, one sentence with these parts, nothing on standard output, or with --json the
// same as an object.
inline void refused(const std::string& arguments, int status, const std::vector<std::string>& parts,
                    int line) {
  const Outcome o = run(arguments);
  that(o.status == status, o, "exit status " + std::to_string(status), line);
  that(one_sentence(o.err), o, "one sentence on standard error", line);
  if (contains(arguments, "--json")) {
    const Json json(o.out);
    that(json.ok && json.object, o, "JSON on standard output", line);
    that(json.number("error.status") == status, o, "the status in it", line);
    that("servosense: " + json.text("error.message") + "\n" == o.err, o, "the sentence in it",
         line);
  } else {
    that(o.out.empty(), o, "nothing on standard output", line);
  }
  for (const std::string& part : parts) that(contains(o.err, part), o, "says '" + part + "'", line);
}

// ---- the frame of a test -----------------------------------------------------------------------

/// Calls `tests` in a folder of its own, which stays when something failed. Returns the status.
template <typename Tests>
int in_own_folder(const std::string& name, Tests tests) {
  program = std::getenv("SERVOSENSE_PROGRAM");
  if (program == nullptr) {
    std::cout << "SKIPPED: SERVOSENSE_PROGRAM does not say where the program is\n";
    return check::done();
  }
  folder = fs::temp_directory_path() / ("servosense_" + name + "_" + std::to_string(getpid()));
  fs::create_directories(folder);
  tests();
  if (check::failures == 0) fs::remove_all(folder);
  return check::done();
}

}  // namespace program_test
