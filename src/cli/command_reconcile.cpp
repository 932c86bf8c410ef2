// servosense reconcile: where do model and measurement disagree, and which effect is missing?
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <optional>
#include <sstream>
#include <string>
#include <system_error>
#include <utility>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/io/coefficient_file.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/io/unit_watch.hpp"
#include "servosense/io/write_file.hpp"
#include "servosense/model/cutting_effects.hpp"
#include "servosense/reconcile/cutting.hpp"
#include "servosense/reconcile/drive.hpp"

namespace servosense::cli {
namespace {

constexpr const char* kJson = "reconcile.json";
constexpr const char* kMachine = "machine.ini";
constexpr const char* kPage = "report.html";

struct Inputs {
  std::string trace;
  std::optional<Channel> channel;
  std::optional<std::string> proof, since;
};

/// The answer to a record that cannot be compared with anything.
reconcile::Report unreadable(const Error& error, std::optional<Channel> channel, bool of_a_cut) {
  reconcile::Report report;
  if (channel) report.channel = std::string(name_of(*channel));
  report.verdict = reconcile::Verdict::unexplained;
  report.summary = report.residual_detail = error.sentence;
  report.residual_white = false;
  if (of_a_cut) {
    for (const CuttingEffectInfo& info : kCuttingEffects)
      report.not_testable.push_back({info.name, error.sentence, info.splitting_experiment});
    return report;
  }
  for (std::size_t i = 0; i < kDriveEffectCount; ++i)
    report.not_testable.push_back(
        {kDriveEffects[i].name, error.sentence, kDriveEffectTraits[i].splitting_motion});
  return report;
}

/// A trace with the forces of a cut is compared with the milling model, any other with a drive's.
/// What is found is written into `machine`. `refused`: the answer to a record that shows nothing.
Expected<reconcile::Report> compare(MachineFile& machine, const Inputs& in,
                                    const reconcile::Options& options, reconcile::Report& refused) {
  const auto refuse = [&](const Error& error, bool of_a_cut = false) {
    refused = unreadable(error, in.channel, of_a_cut);
    return error;
  };
  const std::string provenance = "servosense reconcile, " + in.trace;
  if (!in.channel && machine.has_section("tool")) {
    const auto trace = read_trace(in.trace);
    if (!trace) return refuse(trace.error(), true);
    if (reconcile::has_cutting_forces(*trace)) {
      if (in.proof || in.since)
        return usage_error("--proof-trace and --changed-since are for drives; " + in.trace +
                           " has the forces of a cut");
      if (auto done = check_units(*trace, column_choices(machine), in.trace); !done)
        return refuse(done.error(), true);
      auto joined = with_coefficients(machine);  // what it corrects goes into the machine file
      if (!joined) return refuse(joined.error(), true);
      machine = std::move(*joined);
      auto data = reconcile::read_cutting(machine, *trace, options.criteria);
      if (!data) return refuse(data.error(), true);
      auto outcome = reconcile::reconcile_cutting(*data, options);
      if (!outcome) return refuse(outcome.error(), true);
      reconcile::augment(machine, *outcome, provenance);
      return std::move(outcome->report);
    }
  }
  auto data = reconcile::read_drive(machine, in.trace, in.channel, options.criteria);
  if (!data) {
    // Forces of a cut, and no tool to compare them with; or one of the two.
    const auto trace = read_trace(in.trace);
    if (!in.channel && trace &&
        (reconcile::has_cutting_forces(*trace) || reconcile::has_one_cutting_force(*trace)))
      if (auto cut = reconcile::read_cutting(machine, *trace, options.criteria); !cut)
        return refuse(cut.error(), true);
    return refuse(data.error());
  }
  const MachineFile before = machine;
  std::optional<reconcile::DriveData> other;
  if (const auto& path = in.since ? in.since : in.proof) {
    auto read = reconcile::read_drive(machine, *path, data->channel, options.criteria);
    if (!read) return refuse(read.error());
    other = std::move(*read);
  }
  if (in.since) {
    auto changes = reconcile::changes_since(*other, *data, options);
    if (!changes) {
      refused = reconcile::refusal(*data, changes.error(), options);
      return changes.error();
    }
    reconcile::augment(machine, changes->earlier, "servosense reconcile, " + *in.since);
    reconcile::choose_for_monitors(machine, before, *other, changes->earlier.report);
    reconcile::augment(machine, changes->later, provenance);
    reconcile::choose_for_monitors(machine, before, *data, changes->later.report);
    return std::move(changes->later.report);
  }
  auto outcome = reconcile::reconcile_drive(*data, options, other ? &*other : nullptr);
  if (!outcome) {
    refused = reconcile::refusal(*data, outcome.error(), options);
    return outcome.error();
  }
  reconcile::augment(machine, *outcome, provenance);
  reconcile::choose_for_monitors(machine, before, *data, outcome->report);
  return std::move(outcome->report);
}

int run_reconcile(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  std::optional<Channel> channel;
  if (const auto name = arguments.value("--channel")) {
    channel = channel_from(*name);
    if (!channel || !is_drive(*channel))
      return fail(usage_error("--channel takes x, y, z, a, b, c, spindle or spindle2, not '" +
                              *name + "'"));
  }
  const Inputs inputs{arguments.at("--trace"), channel, arguments.value("--proof-trace"),
                      arguments.value("--changed-since")};
  if (inputs.proof && inputs.since)
    return fail(usage_error("--proof-trace and --changed-since do not go together"));
  std::error_code absent;
  for (const auto& [option, other] :
       {std::pair{"--proof-trace", inputs.proof}, std::pair{"--changed-since", inputs.since}})
    if (other && std::filesystem::equivalent(*other, inputs.trace, absent))
      return fail(usage_error(std::string(option) + " " + *other +
                              " is the trace itself, which proves nothing; give another record"));
  reconcile::Options options;
  for (const std::string& assignment : arguments.all("--criterion"))
    if (auto done = set_criterion(options.criteria, assignment); !done) return fail(done.error());
  reconcile::Report refused;
  auto report = [&] {
    Progress progress("reconciling", arguments.quiet());
    options.progress = [&](const char* step, std::size_t done, std::size_t of) {
      progress.show(step, done, of);
    };
    return compare(*machine, inputs, options, refused);
  }();
  if (!report && report.error().kind != ErrorKind::data) return fail(report.error());

  const std::string out = arguments.at("--out");
  std::error_code failed;
  std::filesystem::create_directories(out, failed);
  if (failed) return fail(device_error(out + ": cannot create the folder; " + failed.message()));
  std::ostringstream json;
  if (!report) {
    // Scripts find the reason in the file too, and no name.
    refused.criteria = options.criteria;
    reconcile::write_json(refused, json);
    if (auto done = write_file(out + "/" + kJson, json.str()); !done) return fail(done.error());
    return fail(report.error());
  }
  reconcile::write_json(*report, json);
  if (auto done = write_file(out + "/" + kJson, json.str()); !done) return fail(done.error());
  if (auto done = machine->write(out + "/" + kMachine); !done) return fail(done.error());
  if (auto done = reconcile::write_page(*report, out + "/" + kPage); !done)
    return fail(done.error());

  if (arguments.json()) {
    std::cout << json.str();
    return 0;
  }
  for (const reconcile::BadSignal& bad : report->bad_signals) say("%s\n", sentence_of(bad).c_str());
  say("%s\n", report->summary.c_str());
  if (const std::string words = maintenance_advice_of(*report); !words.empty())
    say("%s\n", words.c_str());
  if (const std::string proof = proof_of(*report); !proof.empty()) say("%s\n", proof.c_str());
  say("written to %s\n", out.c_str());
  return 0;
}

}  // namespace

Program reconcile_program() {
  return {
      {"reconcile",
       "where model and measurement disagree, which effect is missing, and the proof",
       {{"--machine", "FILE", "machine file: the model", true, FileUse::input},
        {"--trace", "FILE", "trace: the measurement, of moves without cutting or of one cut", true,
         FileUse::reread},
        {"--channel", "NAME",
         "x, y, z, a, b, c, spindle or spindle2; otherwise the first of these that moves", false},
        {"--proof-trace", "FILE",
         "a second trace of the same drive: what does not hold on it is not named", false,
         FileUse::input},
        {"--changed-since", "FILE",
         "an earlier trace of the same moves: what has changed on the drive since", false,
         FileUse::input},
        {"--out",
         "DIR",
         "folder for reconcile.json, machine.ini and report.html",
         true,
         FileUse::folder,
         {kJson, kMachine, kPage}},
        {"--criterion",
         "NAME=VALUE",
         "decide by another limit; may be repeated; the report lists them all",
         false,
         FileUse::none,
         {},
         true}},
       "",
       "Record moves in both directions, at several speeds, with reversals and some laps of the "
       "same\nprogram. The last third of the trace is kept for the proof.\n\n"
       "Of a cut: dyno.force_x_N and dyno.force_y_N, spindle.angle_rad and "
       "tool.feed_per_tooth_m, with\n[tool] and [cut] in the machine file; 60 revolutions at "
       "each of three feeds."},
      run_reconcile};
}

}  // namespace servosense::cli
