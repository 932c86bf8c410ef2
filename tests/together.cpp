#include "together.hpp"

#include <cstdio>

int main(int argc, char** argv) {
  const auto test = check::tests().find(argc > 1 ? argv[1] : "");
  if (test != check::tests().end()) return test->second(argc - 1, argv + 1);
  std::printf("usage: %s BLOCK [OPTION...]\n", argv[0]);
  for (const auto& [block, run] : check::tests()) std::printf("  %s\n", block.c_str());
  return 2;
}
