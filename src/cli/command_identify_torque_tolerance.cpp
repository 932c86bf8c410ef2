// servosense identify torque-tolerance: the smallest tolerance about a predicted torque that sound
// runs ask for (Bertok 1984, section 5.4: "the smallest tolerances without alarm").
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "output_check.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_file.hpp"
#include "torque_band_runs.hpp"

namespace servosense::cli {
namespace {

constexpr const char* kWatches = "monitor.torque-band";
/// Shares are found to this; more than `kMostShare` is no tolerance any more.
constexpr double kShareGrain = 0.005, kMostShare = 2;

int run_identify_torque_tolerance(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  const std::vector<std::string>& traces = arguments.operands();
  if (traces.empty())
    return fail(usage_error("give one trace or more, each of a sound run of the program"));
  for (const std::string& path : traces)
    if (auto done = check_rereadable(path); !done) return fail(done.error());
  const std::string& table = arguments.at("--prediction");
  MachineFile watching = *machine;
  watching.set(kWatches, "reference", std::filesystem::absolute(table).string());
  watching.set(kWatches, "enabled", "yes");
  Progress progress("reading", arguments.quiet());
  std::vector<HeldRun> held;
  std::size_t outside = 0;
  const auto holds = [&](double share) -> Expected<bool> {
    watching.set(kWatches, "tolerance_share", share);
    held.clear();
    for (std::size_t i = 0; i < traces.size(); ++i) {
      const auto run = hold_torque_run(watching, traces[i], progress);
      if (!run) return run.error();
      held.push_back(*run);
      if (run->worst >= kSoundRun) {
        outside = i;
        return false;
      }
    }
    return true;
  };
  double low = 0, high = kMostShare;
  const auto most = holds(high);
  if (!most) return fail(most.error());
  if (!*most)
    return fail(data_error(
        traces[outside] + ": leaves the prediction at " + std::to_string(held[outside].worst_s) +
        " s whatever the tolerance; the run is not sound, is another program, or its blocks are "
        "not the lines of " +
        table));
  const auto least = holds(low);
  if (!least) return fail(least.error());
  if (*least) high = low;
  while (high - low > kShareGrain) {
    const double middle = (low + high) / 2;
    const auto ok = holds(middle);
    if (!ok) return fail(ok.error());
    (*ok ? high : low) = middle;
  }
  if (const auto ok = holds(high); !ok) return fail(ok.error());
  if (const auto out = arguments.value("--out")) {
    machine->set(kWatches, "tolerance_share", high);
    if (const auto done = machine->write(*out); !done) return fail(done.error());
  }
  if (!arguments.json()) {
    say("tolerance_share = %.3g is the smallest about the prediction that %zu run(s) ask for\n",
        high, traces.size());
    return 0;
  }
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("tolerance_share", high);
  json.member("runs", traces.size());
  std::vector<double> worst;
  for (const HeldRun& run : held) worst.push_back(run.worst);
  json.values("held", worst);
  json.end_object();
  std::cout << '\n';
  return 0;
}

}  // namespace

Program identify_torque_tolerance_program() {
  return {
      {"identify torque-tolerance",
       "the smallest tolerance about a predicted torque that sound runs ask for",
       {{"--machine", "FILE", "machine file, with the spindle", true, FileUse::input},
        {"--prediction", "CSV", "table of 'program predict'", true, FileUse::input},
        {"--out", "FILE", "machine file to write, with tolerance_share", false, FileUse::renewed}},
       "TRACE...",
       "Each trace is a sound run of the predicted program, with machine.nc_block, the line of "
       "the program. The\n"
       "monitor watches them with less and less tolerance_share, until one would warn."},
      run_identify_torque_tolerance};
}

}  // namespace servosense::cli
