// Draws blind cases for `servosense reconcile`: what the user has, and the truth in a file of its
// own.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "case.hpp"

namespace {

constexpr const char* kHelp =
    "blind_cases --case DOMAIN/CELL[/EFFECT] --seed N --out DIR [--variant V]\n"
    "  writes DIR/machine.ini and DIR/trace.csv (what the user has) and DIR/truth.json\n"
    "  --variant   plain, units, reversed, decimated, offset: the name must not change\n"
    "blind_cases --list\n"
    "  all cells; where one ends in an effect, it may be left out and is then drawn\n"
    "Seeds below 100000 are for development, those from there on for scoring.\n";

int usage(const std::string& sentence) {
  std::fprintf(stderr, "blind_cases: %s\n%s", sentence.c_str(), kHelp);
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  std::string name, out, variant = "plain";
  std::uint64_t seed = 1;
  for (int i = 1; i < argc; ++i) {
    const std::string key = argv[i];
    if (key == "--help") return std::fputs(kHelp, stdout), 0;
    if (key == "--list") {
      for (const std::string& cell : blind::cells()) std::puts(cell.c_str());
      return 0;
    }
    if (i + 1 >= argc) return usage("'" + key + "' needs a value");
    const std::string value = argv[++i];
    if (key == "--case")
      name = value;
    else if (key == "--seed")
      seed = std::strtoull(value.c_str(), nullptr, 10);
    else if (key == "--out")
      out = value;
    else if (key == "--variant")
      variant = value;
    else
      return usage("unknown option '" + key + "'");
  }
  if (name.empty() || out.empty()) return usage("--case and --out are needed");
  blind::write_case(blind::draw_case(name, seed, variant), out);
  return 0;
}
