// The pages of docs/: every one is reached from the page of contents, no link leads nowhere, and
// every command has its line there; the paths that contributing.md names exist. Figures
// (docs/claims.csv: page, its text, the command that prints it, the bound as the source of that
// command has it, where it runs): the text still stands in the page, the bound in the source, and
// what runs at night is in .ci/nightly, all of it.
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "check.hpp"
#include "program.hpp"

namespace {

using namespace program_test;

std::set<std::string> links(const fs::path& page) {
  std::set<std::string> found;
  const std::string text = content(page);
  const std::regex link(R"(\]\(([^)#\s]+)(#[^)]*)?\))");
  for (std::sregex_iterator at(text.begin(), text.end(), link), end; at != end; ++at)
    found.insert((*at)[1].str());
  return found;
}

void every_page_is_reached() {
  const std::set<std::string> contents = links("docs/README.md");
  CHECK(contents.size() > 30);
  for (const auto& entry : fs::directory_iterator("docs")) {
    const std::string name = entry.path().filename().string();
    if (!name.ends_with(".md") || name == "README.md") continue;
    check::that(contents.contains(name), ("docs/README.md leads to " + name).c_str(), __FILE__,
                __LINE__);
  }
}

void no_link_leads_nowhere() {
  std::size_t followed = 0;
  for (const auto& entry : fs::directory_iterator("docs")) {
    if (entry.path().extension() != ".md") continue;
    for (const std::string& link : links(entry.path())) {
      if (link.starts_with("http")) continue;
      ++followed;
      check::that(fs::exists(entry.path().parent_path() / link),
                  (entry.path().string() + " leads to " + link).c_str(), __FILE__, __LINE__);
    }
  }
  for (const std::string& link : links("README.md"))
    if (!link.starts_with("http"))
      check::that(fs::exists(link), ("README.md leads to " + link).c_str(), __FILE__, __LINE__);
  CHECK(followed > 60);
}

/// Paths between backticks that are not in the tree. A path has a slash and no gap to be filled
/// (<room>, *, ...); a header may be told from its room on. What a build makes is not there yet.
std::vector<std::string> absent_paths(const std::string& page, std::size_t& looked_at) {
  std::vector<std::string> absent;
  const std::string text = std::regex_replace(page, std::regex("```[^`]*```"), "");
  const std::regex code("`([^`\\s]+)[^`]*`"),
      path(R"(\.?[A-Za-z0-9_][A-Za-z0-9_.-]*/[A-Za-z0-9_./-]*)");
  for (std::sregex_iterator at(text.begin(), text.end(), code), end; at != end; ++at) {
    const std::string named = (*at)[1].str();
    if (!std::regex_match(named, path) || named.starts_with("build/")) continue;
    ++looked_at;
    if (!fs::exists(named) && !fs::exists("include/servosense/" + named)) absent.push_back(named);
  }
  return absent;
}

void contributing_names_what_is_there() {
  std::size_t looked_at = 0;
  for (const std::string& path : absent_paths(content("docs/contributing.md"), looked_at))
    check::that(false, ("docs/contributing.md names " + path).c_str(), __FILE__, __LINE__);
  CHECK(looked_at > 60);
  looked_at = 0;
  const std::string planted =
      "`src/cli/nowhere.cpp`, `.ci/nobody x`, `core/status.hpp`, `src/<room>/a.cpp`, `core`";
  CHECK(absent_paths(planted, looked_at) ==
        (std::vector<std::string>{"src/cli/nowhere.cpp", ".ci/nobody"}));
  CHECK(looked_at == 3);
}

// A file of more than 450 lines stands in contributing.md with a reason.
// Those of reconcile have its own rules.
void long_files_have_a_reason() {
  constexpr std::size_t kLong = 450;
  const std::string page = content("docs/contributing.md");
  std::size_t looked_at = 0;
  for (const char* root : {"include", "src"})
    for (const auto& entry : fs::recursive_directory_iterator(root)) {
      const std::string path = entry.path().string();
      if (!entry.is_regular_file() || contains(path, "/reconcile/")) continue;
      ++looked_at;
      const std::string text = content(path);
      const bool is_long = std::count(text.begin(), text.end(), '\n') > static_cast<long>(kLong);
      if (is_long) check::that(contains(page, "`" + path + "`"), path.c_str(), __FILE__, __LINE__);
    }
  CHECK(looked_at > 200);
}

// Names of commands in the overview stand between two blanks and a longer gap.
std::set<std::string> commands() {
  std::set<std::string> names;
  for (const std::string& line : lines(run("help").out)) {
    const std::size_t gap = line.find("  ", 2);
    if (line.starts_with("  ") && gap != std::string::npos) names.insert(line.substr(2, gap - 2));
  }
  return names;
}

void every_command_has_its_line() {
  const std::set<std::string> names = commands();
  CHECK(names.size() >= 10);
  const std::string contents = content("docs/README.md");
  for (const std::string& name : names)
    check::that(contains(contents, "`servosense " + name + "`"),
                ("docs/README.md names " + name).c_str(), __FILE__, __LINE__);
}

// Man page and completion come from the table of --help: nothing that one has is missing in others.
void man_page_and_completion() {
  const Outcome man = run("help --man"), bash = run("help --bash-completion");
  const Outcome zsh = run("help --zsh-completion");
  that(zsh.status == 0 && zsh.out.starts_with("#compdef servosense\n"), zsh, "a script", __LINE__);
  that(man.status == 0 && man.out.starts_with(".TH SERVOSENSE 1"), man, "a man page", __LINE__);
  that(bash.status == 0, bash, "a script", __LINE__);
  std::string plain = man.out;
  plain.erase(std::remove(plain.begin(), plain.end(), '\\'), plain.end());
  for (const std::string& name : commands()) {
    const Outcome help = run("help " + name);
    const std::regex option(R"(\n  (--[a-z0-9A-Z-]+))");
    for (std::sregex_iterator at(help.out.begin(), help.out.end(), option), end; at != end; ++at) {
      that(contains(plain, (*at)[1].str()), man, name + " has " + (*at)[1].str(), __LINE__);
      that(contains(bash.out, (*at)[1].str()), bash, name + " has " + (*at)[1].str(), __LINE__);
      const std::size_t of = zsh.out.find("'" + name + "') _arguments");
      const std::string own =
          zsh.out.substr(std::min(of, zsh.out.size()), zsh.out.find(";;", of) - of);
      that(contains(own, "'" + (*at)[1].str() + "["), zsh, name + " has " + (*at)[1].str(),
           __LINE__);
    }
  }
  std::ofstream(folder / "complete.sh")
      << bash.out
      << "COMP_WORDS=(servosense identify id); COMP_CWORD=2; _servosense\n"
         "echo ${COMPREPLY[@]}\n"
         "COMP_WORDS=(servosense lobes --me); COMP_CWORD=2; _servosense\necho ${COMPREPLY[@]}\n";
  std::ofstream(folder / "_servosense") << zsh.out;
  if (std::system("command -v zsh > /dev/null") == 0)
    CHECK(std::system(("zsh -n '" + (folder / "_servosense").string() + "'").c_str()) == 0);
  const std::string line = "bash '" + (folder / "complete.sh").string() + "' > '" +
                           (folder / "completed.txt").string() + "'";
  CHECK(std::system(line.c_str()) == 0);
  CHECK(content(folder / "completed.txt") == "idle\n--method\n");
}

std::vector<std::string> fields(const std::string& line) {
  std::vector<std::string> found(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line[i] == '"' && quoted && i + 1 < line.size() && line[i + 1] == '"')
      found.back() += line[i++];
    else if (line[i] == '"')
      quoted = !quoted;
    else if (line[i] == ',' && !quoted)
      found.emplace_back();
    else
      found.back() += line[i];
  }
  return found;
}

std::string on_one_line(const std::string& text) {
  return std::regex_replace(text, std::regex(R"(\s+)"), " ");
}

// `test_<room> <block> [option...]`, `test_<room>_<block>`, or a script.
std::string source_of(const std::string& command) {
  std::smatch part;
  if (!std::regex_search(command, part, std::regex("^test_([a-z]+)[ _]([a-z_]+)")))
    return command.substr(0, command.find(' '));
  return "tests/" + part[1].str() + "/test_" + part[2].str() + ".cpp";
}

// The lines of .ci/nightly that belong to a part.
std::string part_of_the_night(const std::string& name) {
  const std::string all = content(".ci/nightly");
  const std::size_t begin = all.find("\npart_" + name + "() {");
  return begin == std::string::npos ? "" : all.substr(begin, all.find("}\n", begin) - begin);
}

bool runs_in(const std::string& part, const std::string& room, const std::string& block) {
  const std::regex line("studies " + room + "( [a-z_]+)* " + block + "\\b|test_" + room + "_" +
                        block + " --nightly");
  return std::regex_search(part, line);
}

void every_figure_has_its_test() {
  std::vector<std::string> rows = lines(content("docs/claims.csv"));
  CHECK(rows.size() > 50 && rows[0] == "page,text,command,bound,where");
  rows.erase(rows.begin());
  for (const std::string& row : rows) {
    const std::vector<std::string> f = fields(row);
    const auto holds = [&](bool ok, const char* what) {
      check::that(ok, (std::string(what) + ": " + row).c_str(), __FILE__, __LINE__);
    };
    if (f.size() != 5) {
      holds(false, "five fields");
      continue;
    }
    const std::string& command = f[2];
    const std::string source = source_of(command);
    holds(contains(content(f[0]), f[1]), "the page says so");
    holds(fs::exists(source), "there is such a program");
    if (!fs::exists(source)) continue;
    holds(contains(on_one_line(content(source)), on_one_line(f[3])), "the program holds the bound");
    const bool by_night = contains(command, " --");
    holds(by_night == (f[4] != "ci"), "a plain run is CI's");
    if (!by_night) continue;
    const fs::path path = source;
    holds(runs_in(part_of_the_night(f[4]), path.parent_path().filename().string(),
                  path.stem().string().substr(5)),
          "that part of .ci/nightly runs it");
  }
}

// Every test that does more at night does so.
void the_night_is_complete() {
  const std::string night = content(".ci/nightly");
  std::size_t found = 0;
  for (const auto& entry : fs::recursive_directory_iterator("tests")) {
    const fs::path& path = entry.path();
    const std::string stem = path.stem().string();
    if (path.extension() != ".cpp" || !stem.starts_with("test_") ||
        path == "tests/cli/test_docs.cpp")
      continue;
    if (!contains(content(path), "check::nightly(") && !contains(content(path), "\"--nightly\""))
      continue;
    ++found;
    const std::string room = path.parent_path().filename().string();
    check::that(runs_in(night, room, stem.substr(5)), (".ci/nightly runs " + path.string()).c_str(),
                __FILE__, __LINE__);
  }
  CHECK(found >= 39);
}

}  // namespace

int main() {
  return program_test::in_own_folder("docs", [] {
    every_page_is_reached();
    no_link_leads_nowhere();
    contributing_names_what_is_there();
    long_files_have_a_reason();
    every_command_has_its_line();
    man_page_and_completion();
    every_figure_has_its_test();
    the_night_is_complete();
  });
}
