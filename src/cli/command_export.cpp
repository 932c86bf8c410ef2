// servosense export: a machine file for the C interface.
#include <algorithm>
#include <cctype>
#include <cstdio>
#include <filesystem>
#include <iostream>

#include "commands.hpp"
#include "console.hpp"
#include "servosense/capi/machine_config.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/write_file.hpp"

namespace servosense::cli {
namespace {

/// The name of the file as one of C: machine for machine.h.
std::string c_name(const std::string& path) {
  std::string name = std::filesystem::path(path).stem().string();
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  if (name.empty() || std::isdigit(static_cast<unsigned char>(name[0])) != 0) name = "m" + name;
  return name;
}

Expected<Done> choose(const Arguments& arguments, StackSignals& signals) {
  const auto each = [&](auto change, const char* option, const char* choices) -> Expected<Done> {
    const auto value = arguments.value(option);
    if (!value) return Done{};
    for (const Channel channel : kDriveChannels) {
      std::optional<DriveSignal>& signal = signals.drive(channel);
      if (signal && !change(*signal, *value, is_turning(channel)))
        return usage_error(std::string(option) + " is '" + *value + "', must be " + choices);
    }
    return Done{};
  };
  const auto motion = [](DriveSignal& signal, const std::string& value, bool) {
    if (value == "counts")
      signal.motion = MotionKind::counts;
    else if (value == "position")
      signal.motion = MotionKind::position;
    else if (value == "velocity")
      signal.motion = MotionKind::velocity;
    else
      return false;
    return true;
  };
  const auto effort = [](DriveSignal& signal, const std::string& value, bool turns) {
    if (value == "current")
      signal.effort = EffortKind::current_A;
    else if (value == "force")
      signal.effort = turns ? EffortKind::torque_Nm : EffortKind::force_N;
    else if (value == "torque")
      signal.effort = EffortKind::torque_Nm;
    else
      return false;
    return true;
  };
  if (auto done = each(motion, "--motion", "counts, position or velocity"); !done)
    return done.error();
  return each(effort, "--effort", "current, force or torque");
}

int run_export(const Arguments& arguments) {
  const std::string& path = arguments.at("--c");
  const std::string& out = arguments.at("--out");
  auto machine = MachineFile::read(path);
  if (!machine) return fail(machine.error());
  auto signals = signals_of_file(*machine);
  if (!signals) return fail(signals.error());
  if (auto done = choose(arguments, *signals); !done) return fail(done.error());
  auto made = machine_config(*machine, *signals);
  if (!made) return fail(made.error());
  const std::string title = printable(machine->text("machine", "name").value_or(path), 400);
  if (auto done = write_file(out, c_header(*made, c_name(out), title)); !done)
    return fail(done.error());
  std::size_t effects = 0;
  for (const auto& of_drive : made->effects) effects += of_drive.size();
  if (arguments.json()) {
    JsonWriter json(std::cout, 2);
    json.begin_object();
    json.member("machine", title);
    json.member("header", out);
    json.member("constant", c_name(out));
    json.member("sample_rate_hz", 1 / signals->sample_period_s);
    json.member("effects", static_cast<double>(effects));
    json.member("reference_points", static_cast<double>(made->reference.size()));
    json.objects("monitors", made->monitors, [&](const MonitorAvailability& m) {
      json.member("name", name_of(m.monitor));
      json.member("channel", std::string_view(name_of(m.channel)));
      json.member("runs", m.runs);
      json.member("reason", m.reason);
    });
    json.key("remarks");
    json.begin_array();
    for (const std::string& remark : made->remarks) json.value(remark);
    json.end_array();
    json.end_object();
    std::cout << '\n';
    return 0;
  }
  say("%s: %s at %.6g Hz, %zu effects, %zu points of torque band\n", out.c_str(), title.c_str(),
      1 / signals->sample_period_s, effects, made->reference.size());
  for (const MonitorAvailability& m : made->monitors)
    say("  %-14s on %-8s  %s: %s\n", name_of(m.monitor), std::string(name_of(m.channel)).c_str(),
        m.runs ? "runs" : "does not run", m.reason.c_str());
  for (const std::string& remark : made->remarks) say("  %s\n", remark.c_str());
  return 0;
}

}  // namespace

Program export_program() {
  return {{"export",
           "the machine file as a C initialiser for a controller",
           {{"--c", "FILE", "machine file", true, FileUse::input},
            {"--out", "HEADER", "C header to write; the constant is named after it", true,
             FileUse::output},
            {"--motion", "KIND", "what drives report: counts, position or velocity"},
            {"--effort", "KIND",
             "what drives report: current, force (of the spindle its torque) or torque"}},
           "",
           "Without --motion and --effort: counts where the file has encoder_counts_per_rev, else\n"
           "position; current where it has a torque or force constant, else force. The rate is\n"
           "sample_rate_hz of [machine].\n"},
          run_export};
}

}  // namespace servosense::cli
