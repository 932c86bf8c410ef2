// Which seeds a sweep goes through.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <string>

namespace check {

struct SeedRange {
  std::uint64_t from = 0, cases = 0;
};

/// `--cases N` and `--from SEED` of a test's command line in place of what it takes by itself.
inline SeedRange seed_range(int argc, char** argv, SeedRange usual) {
  for (int i = 1; i + 1 < argc; ++i) {
    const std::string option = argv[i];
    if (option == "--cases") usual.cases = std::strtoull(argv[i + 1], nullptr, 10);
    if (option == "--from") usual.from = std::strtoull(argv[i + 1], nullptr, 10);
  }
  return usual;
}

}  // namespace check
