// servosense reconcile: where do model and measurement disagree, and which effect is missing?
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <optional>
#include <sstream>
#include <system_error>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/io/write_file.hpp"
#include "servosense/reconcile/cutting.hpp"
#include "servosense/reconcile/drive.hpp"

namespace servosense::cli {
namespace {

/// A trace with the forces of a cut is compared with the milling model, any other with a drive's.
/// What is found is written into `machine`.
Expected<reconcile::Report> compare(MachineFile& machine, const std::string& path,
                                    std::optional<Channel> channel) {
  const std::string provenance = "servosense reconcile, " + path;
  if (!channel && machine.has_section("tool")) {
    const auto trace = read_trace(path);
    if (!trace) return trace.error();
    if (reconcile::has_cutting_forces(*trace)) {
      auto data = reconcile::read_cutting(machine, *trace);
      if (!data) return data.error();
      auto outcome = reconcile::reconcile_cutting(*data, {});
      if (!outcome) return outcome.error();
      reconcile::augment(machine, *outcome, provenance);
      return std::move(outcome->report);
    }
  }
  auto data = reconcile::read_drive(machine, path, channel);
  if (!data) return data.error();
  auto outcome = reconcile::reconcile_drive(*data, {});
  if (!outcome) return outcome.error();
  reconcile::augment(machine, *outcome, provenance);
  return std::move(outcome->report);
}

/// The answer to a record that shows nothing.
reconcile::Report untestable(const Error& error, const std::optional<std::string>& channel) {
  reconcile::Report report;
  report.channel = channel.value_or("");
  report.verdict = reconcile::Verdict::unexplained;
  report.summary = report.residual_detail = error.sentence;
  report.residual_white = false;
  for (std::size_t i = 0; i < kDriveEffectCount; ++i)
    report.not_testable.push_back(
        {kDriveEffects[i].name, error.sentence, kDriveEffectTraits[i].splitting_motion});
  return report;
}

int run_reconcile(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  std::optional<Channel> channel;
  if (const auto name = arguments.value("--channel")) {
    channel = channel_from(*name);
    if (!channel || (*channel != Channel::spindle && *channel != Channel::x &&
                     *channel != Channel::y && *channel != Channel::z))
      return fail(usage_error("--channel takes spindle, x, y or z, not '" + *name + "'"));
  }
  const std::string& trace = arguments.at("--trace");
  auto report = compare(*machine, trace, channel);
  if (!report && report.error().kind != ErrorKind::data) return fail(report.error());

  const std::string out = arguments.at("--out");
  std::error_code failed;
  std::filesystem::create_directories(out, failed);
  if (failed) return fail(device_error(out + ": cannot create the folder; " + failed.message()));
  std::ostringstream json;
  if (!report) {
    // Scripts find the reason in the file too, and no name.
    reconcile::write_json(untestable(report.error(), arguments.value("--channel")), json);
    if (auto done = write_file(out + "/reconcile.json", json.str()); !done)
      return fail(done.error());
    return fail(report.error());
  }
  reconcile::write_json(*report, json);
  if (auto done = write_file(out + "/reconcile.json", json.str()); !done) return fail(done.error());
  if (auto done = machine->write(out + "/machine.ini"); !done) return fail(done.error());
  if (auto done = reconcile::write_page(*report, out + "/report.html"); !done)
    return fail(done.error());

  if (arguments.json()) {
    std::cout << json.str();
    return 0;
  }
  std::printf("%s\n", report->summary.c_str());
  std::printf("written to %s\n", out.c_str());
  return 0;
}

}  // namespace

Program reconcile_program() {
  return {
      {"reconcile",
       "where model and measurement disagree, which effect is missing, and the proof",
       {{"--machine", "FILE", "machine file: the model", true},
        {"--trace", "FILE", "trace: the measurement, of moves without cutting", true},
        {"--channel", "NAME", "x, y, z or spindle; otherwise the first of these that moves", false},
        {"--out", "DIR", "folder for reconcile.json, machine.ini and report.html", true}},
       "",
       "Record moves in both directions, at several speeds, with reversals and some laps of the "
       "same\nprogram. The last third of the trace is kept for the proof."},
      run_reconcile};
}

}  // namespace servosense::cli
