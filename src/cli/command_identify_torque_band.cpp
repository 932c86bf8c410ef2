// servosense identify torque-band: the reference of a program from recorded runs of it.
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <utility>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "output_check.hpp"
#include "servosense/identify/torque_band_reference.hpp"
#include "servosense/io/json.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/monitors/torque_band_file.hpp"
#include "torque_band_runs.hpp"

namespace servosense::cli {
namespace {

constexpr const char* kTorqueBandSection = "monitor.torque-band";
constexpr double kWiden = 1.25;
constexpr int kMostWidenings = 12;
// Of the expected torque: runs of a day do not show what other stock and another edge bring.
constexpr double kShare = 0.05;

struct Wanted {
  TorqueBandOptions band;
  TorqueRunOptions run;
};

Expected<Wanted> wanted(const Arguments& arguments) {
  Wanted w;
  w.run.over_path = arguments.has("--spacing-m");
  if (w.run.over_path && arguments.has("--spacing-s"))
    return usage_error(
        "--spacing-s is of a band over time, --spacing-m of one over path; give one");
  const TorqueBandConfig monitor = torque_band_defaults(w.run.over_path);
  const double unit = w.run.over_path ? 0.01 : 1;
  w.run.step = monitor.step;
  w.run.spacing = 0.02 * unit;
  TorqueBandOptions& o = w.band;
  o.above_share = o.below_share = kShare;
  o.lead = o.lag = 0.1 * unit;
  o.max_shift = monitor.max_shift;
  o.sync_shift = monitor.sync_shift;
  o.max_drift = monitor.max_drift;
  o.false_alarms = 0.01;
  const std::string end = w.run.over_path ? "-m" : "-s", other = w.run.over_path ? "-s" : "-m";
  for (const auto& [name, to] :
       {std::pair{"--lead", &o.lead}, std::pair{"--lag", &o.lag},
        std::pair{"--max-shift", &o.max_shift}, std::pair{"--spacing", &w.run.spacing}}) {
    if (arguments.has(name + other))
      return usage_error(name + other + " does not fit a band over " +
                         (w.run.over_path ? "path; give " : "time; give ") + name + end +
                         (w.run.over_path ? "" : ", or --spacing-m for a band over path"));
    auto value = arguments.positive(name + end);
    if (!value) return value.error();
    if (*value) *to = **value;
  }
  for (const auto& [name, to] :
       {std::pair{"--above-share", &o.above_share}, std::pair{"--below-share", &o.below_share},
        std::pair{"--above-Nm", &o.above_Nm}, std::pair{"--below-Nm", &o.below_Nm},
        std::pair{"--false-alarms", &o.false_alarms}}) {
    auto value = arguments.positive(name);
    if (!value) return value.error();
    if (*value) *to = **value;
  }
  return w;
}

/// A file for the attempts: what stands at --out stays until there is something better.
class Attempt {
 public:
  Attempt() {
    std::string name = (std::filesystem::temp_directory_path() / "servosense-XXXXXX").string();
    if (const int fd = ::mkstemp(name.data()); fd >= 0) {
      ::close(fd);
      path_ = name;
    }
  }
  Attempt(const Attempt&) = delete;
  Attempt& operator=(const Attempt&) = delete;
  ~Attempt() {
    std::error_code ignored;
    if (!path_.empty()) std::filesystem::remove(path_, ignored);
  }
  /// Empty when there can be none.
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

std::vector<std::string> comments(const TorqueBand& band, const TorqueBandOptions& o,
                                  std::size_t runs) {
  std::vector<std::string> out = {"torque band taught by " + std::to_string(runs) +
                                  " run(s), servosense identify torque-band"};
  char line[160];
  std::snprintf(
      line, sizeof line,
      "tolerance for false alarms in %.3g %% of sound runs at most; torque of a cut between "
      "runs +-%.2g %% (%s)",
      100 * o.false_alarms, 100 * band.level_deviation, runs < 2 ? "assumed" : "learned");
  out.emplace_back(line);
  return out;
}

int run_identify_torque_band(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  // What it shall be is not needed to find it.
  machine->remove(kTorqueBandSection, "reference");
  const std::vector<std::string>& traces = arguments.operands();
  if (traces.empty())
    return fail(usage_error("give one trace or more, each of a whole sound run of the program"));
  for (const std::string& path : traces)
    if (auto done = check_rereadable(path); !done) return fail(done.error());
  auto w = wanted(arguments);
  if (!w) return fail(w.error());
  Progress progress("reading", arguments.quiet());
  std::vector<TorqueRun> runs;
  for (const std::string& path : traces) {
    auto run =
        read_torque_run(*machine, path, w->run, progress, runs.empty() && !arguments.quiet());
    if (!run) return fail(run.error());
    runs.push_back(std::move(*run));
  }
  const std::string& out = arguments.at("--out");
  const Attempt attempt;
  if (attempt.path().empty())
    return fail(device_error("no file can be made in the folder of temporary files; set TMPDIR"));
  MachineFile watching = *machine;
  watching.set(kTorqueBandSection, "reference", std::filesystem::absolute(attempt.path()).string());
  watching.set(kTorqueBandSection, "enabled", "yes");
  // The monitor itself says whether the runs stay in the band that they have taught.
  Expected<TorqueBand> band = make_torque_band(runs, w->band);
  std::vector<HeldRun> held;
  for (int n = 0;; ++n) {
    if (!band) return fail(band.error());
    const TorqueBandReference reference{band->spacing, w->run.over_path, band->points,
                                        band->sections, band->air_limit_Nm};
    const auto write = [&](const std::string& path) {
      return write_torque_band(path, reference, comments(*band, w->band, runs.size()));
    };
    if (auto done = write(attempt.path()); !done) return fail(done.error());
    held.clear();
    double worst = 0;
    for (const std::string& path : traces) {
      auto one = hold_torque_run(watching, path, progress);
      if (!one) return fail(one.error());
      worst = std::max(worst, one->worst);
      held.push_back(*one);
    }
    if (worst < kSoundRun) {
      if (auto done = write(out); !done) return fail(done.error());
      break;
    }
    if (n == kMostWidenings) {
      const auto run = std::max_element(held.begin(), held.end(),
                                        [](auto& a, auto& b) { return a.worst < b.worst; });
      char at[32];
      std::snprintf(at, sizeof at, "%.3f", run->worst_s);
      return fail(data_error(traces[static_cast<std::size_t>(run - held.begin())] +
                             ": leaves the band that it has taught at " + at +
                             " s; the runs do not repeat there: leave it out, or give --lead, "
                             "--lag, --above-Nm and --below-Nm"));
    }
    w->band.widening *= kWiden;
    band = make_torque_band(runs, w->band);
  }
  const char* unit = w->run.over_path ? "m" : "s";
  const double length = band->spacing * static_cast<double>(band->points.size());
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("out", out);
    json.member(std::string("program_") + unit, length);
    json.member(std::string("spacing_") + unit, band->spacing);
    json.values(std::string("shifts_") + unit, band->shift);
    json.member("runs", static_cast<double>(runs.size()));
    json.member("sections", static_cast<double>(band->sections.size()));
    json.member(std::string("unmatched_") + unit, band->unmatched);
    json.member("level_deviation", band->level_deviation);
    json.member("false_alarms", w->band.false_alarms);
    json.member("widening", w->band.widening);
    std::vector<double> worst;
    for (const HeldRun& run : held) worst.push_back(run.worst);
    json.values("held", worst);
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  say("%.4g %s of steady turning in %zu section(s), a point every %.4g %s, from %zu run(s)\n",
      length, unit, band->sections.size(), band->spacing, unit, runs.size());
  for (std::size_t i = 1; i < band->shift.size(); ++i)
    say("  %s came %.3g %s later than the first\n", traces[i].c_str(), band->shift[i], unit);
  if (runs.size() == 1)
    say("one run shows no spread: cuts are assumed to differ by %.2g %% from run to run (standard "
        "deviation), for false alarms in %.3g %% of sound runs; teach two runs or more\n",
        100 * band->level_deviation, 100 * w->band.false_alarms);
  else
    say("cuts differ by %.2g %% from run to run (standard deviation); false alarms in %.3g %% of "
        "sound runs at most\n",
        100 * band->level_deviation, 100 * w->band.false_alarms);
  if (band->unmatched > 0)
    say("%.3g %s are not in all runs: nothing is expected there\n", band->unmatched, unit);
  if (w->band.widening > 1)
    say("what was learned had to be widened by %.2f for the runs to stay within it\n",
        w->band.widening);
  for (std::size_t i = 0; i < held.size(); ++i)
    say("  %s: at most %.0f %% of an alarm\n", traces[i].c_str(), 100 * held[i].worst);
  say("written to %s; name it as reference in [monitor.torque-band]\n", out.c_str());
  return 0;
}

}  // namespace

Program identify_torque_band_program() {
  return {
      {"identify torque-band",
       "expected torque of a program, with its tolerances, from sound runs of it",
       {{"--machine", "FILE", "machine file", true, FileUse::input},
        {"--out", "FILE", "reference to write (CSV)", true, FileUse::renewed},
        {"--false-alarms", "P", "share of sound runs that may leave the band (0.01)", false},
        {"--above-share", "R", "tolerance above the highest run, part of the torque (0.05)", false},
        {"--below-share", "R", "the same below the lowest (0.05)", false},
        {"--above-Nm", "X", "tolerance above, besides the share (0)", false},
        {"--below-Nm", "X", "the same below (0)", false},
        {"--lead-s", "T", "time by which the torque may come early (0.1)", false},
        {"--lag-s", "T", "time by which it may come late (0.1)", false},
        {"--max-shift-s", "T", "most that the first cut of a run may be off (1)", false},
        {"--spacing-s", "T", "distance of the points (0.02)", false},
        {"--spacing-m", "X", "the same of a band over path instead of time, as 0.0002", false},
        {"--lead-m", "X", "path by which the torque may come early (0.001)", false},
        {"--lag-m", "X", "path by which it may come late (0.001)", false},
        {"--max-shift-m", "X", "most that the first cut of a run may be off (0.01)", false}},
       "TRACE...",
       "Each trace is one whole run, recorded from the start of the program on. The tolerance is\n"
       "learned from how far the runs differ; of one run it is assumed. Over path the feeds of "
       "the\n"
       "runs may differ."},
      run_identify_torque_band};
}

}  // namespace servosense::cli
