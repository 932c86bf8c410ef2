// The reader against LinuxCNC's own interpreter, `rs274`: end points, arcs, feeds, dwells, tools
// and the line of an error, on LinuxCNC's sample programs and on generated ones (100 by day, 2000
// with
// `--nightly`).
#include <set>

#include "check.hpp"
#include "program_generator.hpp"
#include "rs274.hpp"

namespace {

using namespace servosense::process;
namespace fs = std::filesystem;

/// Tools 1 to `count` in mm for the reader, in inches for `rs274`, which has those units.
std::string tools(int count, double unit_mm) {
  std::string table;
  for (int t = 1; t <= count; ++t) {
    char line[120];
    std::snprintf(line, sizeof line, "T%d P%d D%.12f Z%.12f X%.12f\n", t, t, (1.0 + t) / unit_mm,
                  10.0 * t / unit_mm, 0.5 * (t % 3) / unit_mm);
    table += line;
  }
  return table;
}

/// What docs/nc-program.md names as on purpose other: refused here, known there.
bool refused_on_purpose(const std::string& message) {
  for (const char* part :
       {"probe", "splines", "lathes", "no G8 ", "no G7 ", "M66 read", "machine's own",
        "machine alone", "without D bounds", "compensation of lathe tools"})
    if (message.find(part) != std::string::npos) return true;
  return false;
}

void sample_programs(const fs::path& folder, const ProgramOptions& options, bool nightly) {
  std::vector<fs::path> programs;
  std::vector<const char*> roots = {"/usr/share/linuxcnc"};
  if (nightly) roots.insert(roots.end(), {"/usr/share/doc/linuxcnc", "/usr/share/axis"});
  for (const char* root : roots) {
    std::error_code none;
    for (const auto& entry : fs::recursive_directory_iterator(root, none))
      if (entry.path().extension() == ".ngc") programs.push_back(entry.path());
  }
  std::sort(programs.begin(), programs.end());
  // G43 beside or behind M6, before a move: `rs274` alone takes the last point that it printed for
  // the place of the machine. U and W: it has no such axes.
  const std::set<std::string> other = {"skeleton.ngc", "mmount.ngc", "cone.ngc", "foam.ngc"};
  std::size_t whole = 0, moves = 0, both_refuse = 0, on_purpose = 0;
  for (const fs::path& path : programs) {
    const auto text = ProgramText::read(path.string());
    check::that(text.has_value(), path.c_str(), __FILE__, __LINE__);
    if (!text || other.contains(path.filename().string())) continue;
    const auto theirs = rs274::run(path, folder, folder / "tool.tbl");
    const auto mine = rs274::ours(*text, options);
    std::string differs = rs274::difference(theirs, mine, text->lines());
    if (!differs.empty() && mine.failed && refused_on_purpose(mine.message)) {
      differs = rs274::difference(theirs, mine, text->lines(), true);
      on_purpose += differs.empty();
    } else if (mine.failed) {
      ++both_refuse;
    } else {
      ++whole;
      moves += mine.moves.size();
    }
    check::that(differs.empty(), (path.string() + ": " + differs).c_str(), __FILE__, __LINE__);
  }
  check::figure("sample programs alike to their end", static_cast<double>(whole));
  check::figure("  steps in them", static_cast<double>(moves));
  check::figure("sample programs that both refuse at the same line",
                static_cast<double>(both_refuse));
  check::figure("sample programs refused on purpose, alike until there",
                static_cast<double>(on_purpose));
  CHECK(whole >= (nightly ? 180U : 60U));
}

void generated_programs(const fs::path& folder, ProgramOptions options, unsigned from,
                        unsigned count) {
  std::size_t whole = 0, refused = 0, steps = 0, alike = 0;
  for (unsigned seed = from; seed < from + count; ++seed) {
    const std::string program = ProgramGenerator(seed, {seed % 3 == 0, true}).program();
    const fs::path path = folder / "generated.ngc";
    std::ofstream(path) << program;
    options.block_delete = seed % 2 == 1;
    const ProgramText text = ProgramText::from(program, "generated.ngc");
    const auto theirs = rs274::run(path, folder, folder / "tool.tbl", options.block_delete);
    const auto mine = rs274::ours(text, options);
    const std::string differs = rs274::difference(theirs, mine, text.lines());
    check::that(differs.empty(), ("seed " + std::to_string(seed) + ": " + differs).c_str(),
                __FILE__, __LINE__);
    alike += differs.empty();
    (mine.failed ? refused : whole) += 1;
    steps += mine.moves.size();
  }
  check::figure("generated programs alike to their end", static_cast<double>(whole));
  check::figure("generated programs that both refuse at the same line",
                static_cast<double>(refused));
  check::figure("  steps in them", static_cast<double>(steps));
  CHECK(alike == count);
  CHECK(whole * 3 >= count);
  CHECK(refused * 10 >= count);
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  if (!rs274::installed()) {
    std::cout << "SKIPPED: LinuxCNC's rs274 is not installed (Debian: linuxcnc-uspace)\n";
    return check::done();
  }
  const fs::path folder =
      fs::temp_directory_path() / ("servosense_rs274_" + std::to_string(getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "tool.tbl") << tools(99, 25.4);
  const auto table = tool_table_of(tools(99, 1), "tools");
  CHECK(table.has_value());
  ProgramOptions options;
  options.tools = *table;
  options.most_lines = 3'000'000;
  if (nightly) {
    generated_programs(folder, options, 10'000, 2000);
  } else {
    generated_programs(folder, options, 1, 100);
  }
  sample_programs(folder, options, nightly);
  if (check::failures == 0) fs::remove_all(folder);
  return check::done();
}
