// The pages of docs/: every one is reached from the page of contents, no link leads nowhere, and
// every command has its line there.
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>

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

}  // namespace

int main() {
  return program_test::in_own_folder("docs", [] {
    every_page_is_reached();
    no_link_leads_nowhere();
    every_command_has_its_line();
    man_page_and_completion();
  });
}
