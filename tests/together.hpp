// The tests of a room in one program: `test_<room> <block> [option...]` runs one of them.
#pragma once

#include <functional>
#include <map>
#include <string>

namespace check {

using Main = std::function<int(int, char**)>;

inline std::map<std::string, Main>& tests() {
  static std::map<std::string, Main> all;
  return all;
}

/// Enters the main() of one test, with or without arguments.
struct Test {
  Test(const char* block, int (*run)()) {
    tests()[block] = [run](int, char**) { return run(); };
  }
  Test(const char* block, int (*run)(int, char**)) { tests()[block] = run; }
};

}  // namespace check
