// Runs `servosense reconcile` over blind cases and says how often it is right.
#include <sys/wait.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <tuple>
#include <vector>

#include "case.hpp"
#include "comparator.hpp"
#include "json.hpp"
#include "score.hpp"

namespace {

constexpr const char* kHelp =
    "blind_score --program SERVOSENSE --results FILE [what] [--work DIR] [--variants]\n"
    "            [--no-comparator] [--keep]\n"
    "  runs the cases one after the other and appends a line a case to FILE; cases that are in it\n"
    "  already are left out, so a run that was stopped goes on\n"
    "  what: --cases CELL[,CELL...] --seeds FROM:COUNT   a cell stands for all that begin with it\n"
    "        --set full|tenth|ci                         the sets of docs/blind-tests.md\n"
    "  --variants   also with units scaled, axis reversed, decimated, position offset\n"
    "blind_score --summarise FILE [--json OUT]\n"
    "  tables over all lines\n"
    "blind_score --accept FILE\n"
    "  exit status 1 when a name in FILE is wrong or strong effects were missed\n";

struct Job {
  std::string name;
  std::uint64_t seed;
};

int fail(const std::string& sentence) {
  std::fprintf(stderr, "blind_score: %s\n", sentence.c_str());
  return 2;
}

std::vector<std::string> cells_under(const std::string& prefix) {
  std::vector<std::string> found;
  for (const std::string& cell : blind::cells())
    if ((cell + "/").starts_with(prefix + "/")) found.push_back(cell);
  return found;
}

/// Sizes of the study: 30 cases an effect, 300 nulls, 180 outside, 120 pairs of drives; half of
/// the nulls and outside cases on spindles; 60 pairs in milling. Other cells 30 each.
std::size_t full_size(const std::string& cell) {
  const bool drive = cell.starts_with("drive");
  if (cell.find("/null") != std::string::npos)
    return drive ? 100 : cell.starts_with("spindle") ? 50 : 67;
  if (cell.find("/outside") != std::string::npos) return 30;
  if (cell.ends_with("/pair")) return drive ? 120 : 60;
  if (cell.find("/poor") != std::string::npos) return 10;
  return 30;
}

/// Every cell has seeds of its own, so that no two cells share a machine. The first case of every
/// cell, then the second: a run that is stopped has seen them all.
std::vector<Job> jobs_of(const std::string& set) {
  std::vector<std::pair<std::size_t, Job>> numbered;
  std::uint64_t first = 100000;
  std::size_t index = 0;
  for (const std::string& cell : blind::cells()) {
    std::size_t n = full_size(cell);
    if (set == "tenth") n = (n + 9) / 10;
    // A case from every fourth cell, so that it takes less than a minute.
    if (set == "ci") n = index % 4 == 0 ? 1 : 0;
    for (std::size_t i = 0; i < n; ++i) numbered.push_back({i, {cell, first + i}});
    first += 1000;
    ++index;
  }
  std::stable_sort(numbered.begin(), numbered.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Job> jobs;
  for (auto& [i, job] : numbered) jobs.push_back(std::move(job));
  return jobs;
}

std::vector<blind::Row> read_rows(const std::string& path) {
  std::vector<blind::Row> rows;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);)
    if (const blind::Json json = blind::Json::parse(line); json.kind == blind::Json::Kind::object)
      rows.push_back(blind::row_of(json));
  return rows;
}

std::string in_quotes(const std::filesystem::path& path) { return "'" + path.string() + "'"; }

}  // namespace

int main(int argc, char** argv) {
  std::string program, results, cells, seeds = "1:1", set, work = "blind_work", summarise, accept,
                                       json_out;
  bool variants = false, comparator = true, keep = false;
  for (int i = 1; i < argc; ++i) {
    const std::string key = argv[i];
    if (key == "--help") return std::fputs(kHelp, stdout), 0;
    if (key == "--variants" || key == "--no-comparator" || key == "--keep") {
      (key == "--variants" ? variants
       : key == "--keep"   ? keep
                           : comparator) = key != "--no-comparator";
      continue;
    }
    if (i + 1 >= argc) return fail("'" + key + "' needs a value");
    const std::string value = argv[++i];
    if (key == "--program")
      program = value;
    else if (key == "--results")
      results = value;
    else if (key == "--cases")
      cells = value;
    else if (key == "--seeds")
      seeds = value;
    else if (key == "--set")
      set = value;
    else if (key == "--work")
      work = value;
    else if (key == "--summarise")
      summarise = value;
    else if (key == "--accept")
      accept = value;
    else if (key == "--json")
      json_out = value;
    else
      return fail("unknown option '" + key + "'");
  }

  if (!summarise.empty()) {
    std::string json;
    std::fputs(blind::summary(read_rows(summarise), json).c_str(), stdout);
    if (!json_out.empty()) std::ofstream(json_out) << json;
    return 0;
  }
  if (!accept.empty()) {
    std::string why;
    const bool good = blind::acceptable(read_rows(accept), why);
    std::fputs(why.c_str(), stdout);
    return good ? 0 : 1;
  }
  if (program.empty() || results.empty() || (cells.empty() && set.empty()))
    return fail("--program, --results and --cases or --set are needed; see --help");

  std::vector<Job> jobs;
  if (!set.empty()) {
    if (set != "full" && set != "tenth" && set != "ci")
      return fail("there is no set '" + set + "'");
    jobs = jobs_of(set);
  }
  std::istringstream list(cells);
  for (std::string prefix; std::getline(list, prefix, ',');) {
    const std::vector<std::string> found = cells_under(prefix);
    if (found.empty()) return fail("no cell begins with '" + prefix + "'");
    const std::uint64_t from = std::strtoull(seeds.c_str(), nullptr, 10);
    const auto colon = seeds.find(':');
    const std::uint64_t count =
        colon == std::string::npos ? 1 : std::strtoull(seeds.c_str() + colon + 1, nullptr, 10);
    for (const std::string& cell : found)
      for (std::uint64_t i = 0; i < count; ++i) jobs.push_back({cell, from + i});
  }

  std::set<std::tuple<std::string, std::uint64_t, std::string>> done;
  for (const blind::Row& row : read_rows(results)) done.insert({row.name, row.seed, row.variant});
  std::ofstream out(results, std::ios::app);
  if (!out) return fail("cannot write " + results);
  std::vector<std::string> kinds{"plain"};
  if (variants) kinds.insert(kinds.end(), {"units", "reversed", "decimated", "offset"});
  for (const Job& job : jobs)
    for (const std::string& kind : kinds) {
      const blind::Case c = blind::draw_case(job.name, job.seed, kind);
      if (done.contains({c.name, c.seed, kind})) continue;
      std::string folder = job.name + "-" + std::to_string(job.seed) + "-" + kind;
      for (char& letter : folder) letter = letter == '/' ? '_' : letter;
      const std::filesystem::path at = std::filesystem::path(work) / folder;
      blind::write_case(c, at.string());
      const std::filesystem::path answer = at / "out";
      std::string command = in_quotes(program) + " reconcile --quiet --machine " +
                            in_quotes(at / "machine.ini") + " --trace " +
                            in_quotes(at / "trace.csv");
      if (job.name.starts_with("drive")) command += " --channel x";
      command += " --out " + in_quotes(answer) + " >" + in_quotes(at / "said.txt") + " 2>&1";
      const auto start = std::chrono::steady_clock::now();
      const int status = std::system(command.c_str());
      const double seconds =
          std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      std::stringstream text;
      // Exit status 3: the workflow says what is missing from the data. An answer, not a failure.
      const bool refused = WIFEXITED(status) && WEXITSTATUS(status) == 3;
      if (status == 0) text << std::ifstream(answer / "reconcile.json").rdbuf();
      blind::Row row = blind::score(c, blind::Json::parse(text.str()), seconds);
      if (refused) row.verdict = row.outcome = "refused";
      if (comparator && kind == "plain") {
        row.comparator = blind::plain_library(c);
        // It always keeps a dozen terms: judged by the strongest, as many as are hidden.
        std::vector<blind::SaidEffect> said;
        const std::size_t asked = std::max<std::size_t>(1, c.truth.effects.size());
        for (std::size_t i = 0; i < std::min(asked, row.comparator.size()); ++i)
          said.push_back({row.comparator[i], {}, 1.0});
        // It has no word for a line or for what it does not know, and answers with terms.
        if (!job.name.starts_with("milling"))
          row.comparator_outcome = blind::outcome_of(row.expect, row.truth, said, true);
      }
      out << blind::row_json(row) << std::endl;
      std::string names;
      for (const blind::SaidEffect& s : row.said) names += " " + s.name;
      std::printf("%-52s %7llu %-9s %-16s %-12s%s\n", c.name.c_str(),
                  static_cast<unsigned long long>(c.seed), kind.c_str(), row.verdict.c_str(),
                  row.outcome.c_str(), names.c_str());
      std::fflush(stdout);
      if (!keep && row.outcome != "failed") std::filesystem::remove_all(at);
    }
  return 0;
}
