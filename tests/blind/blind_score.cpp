// Runs `servosense reconcile` over blind cases and says how often it is right.
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "case.hpp"
#include "comparator.hpp"
#include "development_seeds.hpp"
#include "json.hpp"
#include "pictures.hpp"
#include "score.hpp"
#include "summary.hpp"

namespace {

constexpr const char* kHelp =
    "blind_score --program SERVOSENSE --results FILE [what] [--work DIR] [--jobs N] [--variants]\n"
    "            [--no-comparator] [--keep]\n"
    "  runs the cases, N at a time, and appends a line a case to FILE; cases that are in it "
    "already\n"
    "  are left out, so a run that was stopped goes on\n"
    "  what: --cases CELL[,CELL...] --seeds FROM:COUNT   a cell stands for all that begin with it\n"
    "        --set full|tenth|fourth|eighth [--round N]  the sets of docs/blind-tests.md, the "
    "N-th\n"
    "                                                    draw of them (1)\n"
    "  --variants   also with units scaled, axis reversed, decimated, position offset\n"
    "  --order      prints the cases in the order of their running, and runs none\n"
    "blind_score --summarise FILE [--json OUT] [--pictures FOLDER] [--development]\n"
    "  tables over all lines as Markdown; FOLDER/blind_*.svg. No figures come from seeds that "
    "were\n"
    "  looked at before: lines of them are refused without --development\n"
    "blind_score --accept FILE\n"
    "  exit status 1 when a name in FILE is wrong or strong effects were missed\n";

constexpr rlim_t kMostSeconds = 600;  // of processor time, a case

constexpr std::uint64_t kFirstSeed = 100000, kRound = 1000000;  // of scoring, a thousand a cell

const std::vector<std::string> kVariants{"units", "reversed", "decimated", "offset"};

struct Job {
  std::string name;
  std::uint64_t seed;
  std::string variant;
};

struct Choice {
  std::string program, results, work = "blind_work";
  bool comparator = true, keep = false;
  std::size_t jobs = 1;
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
  if (cell.find("/poor") != std::string::npos || cell.find("/file") != std::string::npos) return 10;
  return 30;
}

/// Every cell has seeds of its own, so that no two cells share a machine. The first case of every
/// cell, then each cell in proportion to its size: whenever a run is stopped, it has seen a fair
/// sample of the whole.
/// Each round has other seeds: a version that was made knowing the last round is scored on the
/// next.
std::vector<Job> jobs_of(const std::string& set, std::uint64_t round) {
  std::vector<std::pair<double, Job>> placed;
  std::uint64_t first = kFirstSeed + (round - 1) * kRound;
  std::size_t index = 0;
  for (const std::string& cell : blind::cells()) {
    // The second generator is asked for by name: the sets stay what their figures were made of.
    if (cell.starts_with("second-")) continue;
    std::size_t n = full_size(cell);
    if (set == "tenth") n = (n + 9) / 10;
    // A case from every fourth cell, or from every eighth.
    if (set == "fourth") n = index % 4 == 0 ? 1 : 0;
    if (set == "eighth") n = index % 8 == 0 ? 1 : 0;
    for (std::size_t i = 0; i < n; ++i)
      placed.push_back(
          {static_cast<double>(i) / static_cast<double>(n), {cell, first + i, "plain"}});
    // The first case once more in other units, reversed, decimated, moved.
    if ((set == "full" || set == "tenth") &&
        (cell.starts_with("drive/single") || cell == "drive/null"))
      for (std::size_t v = 0; v < kVariants.size(); ++v)
        placed.push_back({(static_cast<double>(v) + 0.5) / static_cast<double>(kVariants.size()),
                          {cell, first, kVariants[v]}});
    first += 1000;
    ++index;
  }
  std::stable_sort(placed.begin(), placed.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Job> jobs;
  for (auto& [place, job] : placed) jobs.push_back(std::move(job));
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

std::size_t looked_at(const std::vector<blind::Row>& rows) {
  return static_cast<std::size_t>(std::ranges::count_if(rows, [](const blind::Row& row) {
    return ::development::use_of(::development::kBlind, row.seed, 1) != nullptr;
  }));
}

/// Whether a line was cut short when a run was stopped.
bool ends_within_line(const std::string& path) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in || in.tellg() <= 0) return false;
  in.seekg(-1, std::ios::end);
  return in.get() != '\n';
}

struct Ended {
  int status = -1;     ///< of exit; -1 when it did not end by itself
  double seconds = 0;  ///< of processor time
};

/// Runs a program to its end, what it says in `log`.
Ended run(const std::vector<std::string>& arguments, const std::filesystem::path& log) {
  std::vector<char*> list;
  for (const std::string& a : arguments) list.push_back(const_cast<char*>(a.c_str()));
  list.push_back(nullptr);
  const std::string to = log.string();
  const pid_t child = fork();
  if (child == 0) {
    const int out = open(to.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    dup2(out, STDOUT_FILENO);
    dup2(out, STDERR_FILENO);
    const rlimit most{kMostSeconds, kMostSeconds};
    setrlimit(RLIMIT_CPU, &most);
    execv(list.front(), list.data());
    _exit(127);
  }
  Ended ended;
  int status = 0;
  rusage used{};
  if (child < 0 || wait4(child, &status, 0, &used) != child) return ended;
  if (WIFEXITED(status)) ended.status = WEXITSTATUS(status);
  for (const timeval& t : {used.ru_utime, used.ru_stime})
    ended.seconds += static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  return ended;
}

blind::Row scored(const blind::Case& c, const Job& job, const Choice& choice) {
  std::string folder = job.name + "-" + std::to_string(job.seed) + "-" + job.variant;
  for (char& letter : folder) letter = letter == '/' ? '_' : letter;
  const std::filesystem::path at = std::filesystem::path(choice.work) / folder;
  blind::write_case(c, at.string());
  const std::filesystem::path answer = at / "out";
  std::vector<std::string> command{choice.program,
                                   "reconcile",
                                   "--quiet",
                                   "--machine",
                                   (at / "machine.ini").string(),
                                   "--trace",
                                   (at / "trace.csv").string(),
                                   "--out",
                                   answer.string()};
  if (job.name.substr(0, job.name.find('/')).ends_with("drive"))
    command.insert(command.end(), {"--channel", "x"});
  const Ended ended = run(command, at / "said.txt");
  // Exit status 3: the workflow says what is missing from the data. An answer, not a failure.
  const bool refused = ended.status == 3;
  std::stringstream text;
  if (ended.status == 0 || refused) text << std::ifstream(answer / "reconcile.json").rdbuf();
  blind::Row row = blind::score(c, blind::Json::parse(text.str()), ended.seconds);
  if (refused) row.verdict = row.outcome = "refused";
  if (choice.comparator && job.variant == "plain" && !job.name.starts_with("second-")) {
    row.comparator = blind::plain_library(c);
    // It always keeps a dozen terms: judged by the strongest, as many as are hidden.
    std::vector<blind::SaidEffect> said;
    const std::size_t asked = std::max<std::size_t>(1, c.truth.effects.size());
    for (std::size_t i = 0; i < std::min(asked, row.comparator.size()); ++i)
      said.push_back({row.comparator[i], {}, 1.0});
    // It has no word for a line or for what it does not know, and answers with terms.
    if (job.name.find("milling/") == std::string::npos)
      row.comparator_outcome = blind::outcome_of(row.expect, row.truth, said, true);
  }
  if (!choice.keep && row.outcome != "failed") std::filesystem::remove_all(at);
  return row;
}

int run_all(const std::vector<Job>& jobs, const Choice& choice) {
  std::set<std::tuple<std::string, std::uint64_t, std::string>> done;
  for (const blind::Row& row : read_rows(choice.results))
    done.insert({row.name, row.seed, row.variant});
  const bool cut_short = ends_within_line(choice.results);
  std::ofstream out(choice.results, std::ios::app);
  if (!out) return fail("cannot write " + choice.results);
  if (cut_short) out << '\n';
  std::atomic<std::size_t> next{0};
  std::mutex writing;
  const auto work = [&] {
    for (std::size_t j = next++; j < jobs.size(); j = next++) {
      const Job& job = jobs[j];
      // A cell may leave the effect to be drawn, and then names the case by it.
      const auto known = [&](const std::string& name) {
        return done.contains({name, job.seed, job.variant});
      };
      if (known(job.name)) continue;
      const blind::Case c = blind::draw_case(job.name, job.seed, job.variant);
      if (known(c.name)) continue;
      const blind::Row row = scored(c, job, choice);
      std::string names;
      for (const blind::SaidEffect& s : row.said) names += " " + s.name;
      const std::lock_guard lock(writing);
      out << blind::row_json(row) << std::endl;
      std::printf("%-52s %7llu %-9s %-16s %-12s%s\n", c.name.c_str(),
                  static_cast<unsigned long long>(c.seed), job.variant.c_str(), row.verdict.c_str(),
                  row.outcome.c_str(), names.c_str());
      std::fflush(stdout);
    }
  };
  std::vector<std::thread> threads;
  for (std::size_t k = 1; k < choice.jobs; ++k) threads.emplace_back(work);
  work();
  for (std::thread& t : threads) t.join();
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Choice choice;
  std::string cells, seeds = "1:1", set, summarise, accept, json_out, pictures;
  bool variants = false, order = false, development = false;
  std::uint64_t round = 1;
  for (int i = 1; i < argc; ++i) {
    const std::string key = argv[i];
    if (key == "--help") return std::fputs(kHelp, stdout), 0;
    if (key == "--variants" || key == "--no-comparator" || key == "--keep" || key == "--order" ||
        key == "--development") {
      (key == "--development" ? development
       : key == "--variants"  ? variants
       : key == "--keep"      ? choice.keep
       : key == "--order"     ? order
                              : choice.comparator) = key != "--no-comparator";
      continue;
    }
    if (i + 1 >= argc) return fail("'" + key + "' needs a value");
    const std::string value = argv[++i];
    if (key == "--program")
      choice.program = value;
    else if (key == "--results")
      choice.results = value;
    else if (key == "--cases")
      cells = value;
    else if (key == "--seeds")
      seeds = value;
    else if (key == "--set")
      set = value;
    else if (key == "--round")
      round = std::clamp<std::uint64_t>(std::strtoull(value.c_str(), nullptr, 10), 1, 999);
    else if (key == "--work")
      choice.work = value;
    else if (key == "--jobs")
      choice.jobs = std::clamp<std::size_t>(std::strtoull(value.c_str(), nullptr, 10), 1, 64);
    else if (key == "--summarise")
      summarise = value;
    else if (key == "--accept")
      accept = value;
    else if (key == "--json")
      json_out = value;
    else if (key == "--pictures")
      pictures = value;
    else
      return fail("unknown option '" + key + "'");
  }

  if (!summarise.empty()) {
    const std::vector<blind::Row> rows = read_rows(summarise);
    if (const std::size_t seen = looked_at(rows); seen > 0 && !development)
      return fail(std::to_string(seen) + " of " + std::to_string(rows.size()) +
                  " lines are of seeds that were looked at before (tests/development_seeds.hpp); "
                  "take others, or say --development, and call it no figure");
    const blind::Summary summary = blind::summarise(rows);
    std::fputs(blind::summary_text(summary).c_str(), stdout);
    if (!json_out.empty()) std::ofstream(json_out) << blind::summary_json(summary);
    if (pictures.empty()) return 0;
    std::filesystem::create_directories(pictures);
    for (const blind::Picture& p : blind::pictures_of(summary))
      std::ofstream(std::filesystem::path(pictures) / p.file) << p.svg;
    return 0;
  }
  if (!accept.empty()) {
    std::string why;
    const bool good = blind::acceptable(read_rows(accept), why);
    std::fputs(why.c_str(), stdout);
    return good ? 0 : 1;
  }
  if ((!order && (choice.program.empty() || choice.results.empty())) ||
      (cells.empty() && set.empty()))
    return fail("--program, --results and --cases or --set are needed; see --help");

  std::vector<Job> jobs;
  if (!set.empty()) {
    if (set != "full" && set != "tenth" && set != "fourth" && set != "eighth")
      return fail("there is no set '" + set + "'");
    jobs = jobs_of(set, round);
  }
  std::vector<std::string> chosen;
  std::istringstream list(cells);
  for (std::string prefix; std::getline(list, prefix, ',');) {
    const std::vector<std::string> found = cells_under(prefix);
    if (found.empty()) return fail("no cell begins with '" + prefix + "'");
    chosen.insert(chosen.end(), found.begin(), found.end());
  }
  const std::uint64_t from = std::strtoull(seeds.c_str(), nullptr, 10);
  const auto colon = seeds.find(':');
  const std::uint64_t count =
      colon == std::string::npos ? 1 : std::strtoull(seeds.c_str() + colon + 1, nullptr, 10);
  std::vector<std::string> kinds{"plain"};
  if (variants) kinds.insert(kinds.end(), kVariants.begin(), kVariants.end());
  for (std::uint64_t i = 0; i < count; ++i)
    for (const std::string& cell : chosen)
      for (const std::string& kind : kinds) jobs.push_back({cell, from + i, kind});
  if (!order) return run_all(jobs, choice);
  for (const Job& job : jobs)
    std::printf("%s %llu %s\n", job.name.c_str(), static_cast<unsigned long long>(job.seed),
                job.variant.c_str());
  return 0;
}
