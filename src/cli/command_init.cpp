// servosense init: a machine file from data sheets.
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "init_questions.hpp"
#include "servosense/io/data_sheet.hpp"
#include "servosense/io/json.hpp"
#include "servosense/io/machine_classes.hpp"
#include "servosense/io/sheet_figures.hpp"
#include "servosense/io/text.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::cli {
namespace {

/// What the monitors refuse of the file when drives report positions and efforts, which takes no
/// scale from it; "" for nothing.
std::string refusal(const MachineFile& machine) {
  StackSignals signals;
  signals.sample_period_s = 1 / servo_rate_hz(machine);
  bool any = false;
  for (const Channel channel : {Channel::spindle, Channel::spindle2, Channel::x, Channel::y,
                                Channel::z, Channel::a, Channel::b, Channel::c}) {
    const std::string section(section_of(channel));
    if (!machine.has_section(section)) continue;
    const bool turning = drive_kind(section) == DriveKind::turning;
    signals.drive(channel) =
        DriveSignal{MotionKind::position, turning ? EffortKind::torque_Nm : EffortKind::force_N};
    any = true;
  }
  if (!any) return {};
  const auto plan = plan_stack(machine, signals);
  return plan ? "" : plan.error().sentence;
}

std::string idling_step(const std::string& out) {
  return "record the machine moving without a cut, then 'servosense identify idle --machine " +
         out + " --trace TRACE --out OUT2'";
}

void print_json(const SheetReport& report, const std::string& machine_class,
                const std::string& out) {
  const auto values = [](JsonWriter& json, const char* name,
                         const std::vector<SheetReport::Value>& all, const char* from) {
    json.objects(name, all, [&](const SheetReport::Value& v) {
      json.member("key", v.section + "." + v.name);
      json.key("value");
      v.numeric ? json.value(parse_number(v.value).value) : json.value(v.value);
      json.key("unit");
      v.unit.empty() ? json.value(nullptr) : json.value(v.unit);
      json.member(from, v.from);
    });
  };
  JsonWriter json(std::cout, 2);
  json.begin_object();
  json.member("out", out);
  json.key("class");
  machine_class.empty() ? json.value(nullptr) : json.value(machine_class);
  values(json, "given", report.given, "given");
  values(json, "derived", report.derived, "from");
  values(json, "guessed", report.guessed, "source");
  json.objects("missing", report.missing, [&](const SheetReport::Missing& m) {
    json.member("key", m.section + "." + m.key);
    json.member("costs", m.costs);
  });
  json.values("remarks", report.remarks);
  json.member("next_step", idling_step(out));
  json.end_object();
  std::cout << '\n';
}

void print_values(const char* title, const std::vector<SheetReport::Value>& all) {
  if (all.empty()) return;
  say("%s\n", title);
  for (const SheetReport::Value& v : all) {
    std::string line = "  " + v.section + "." + v.name;
    const auto column = [&](std::size_t width, const std::string& text) {
      line.resize(std::max(line.size() + 1, width), ' ');
      line += text;
    };
    column(43, v.value);
    column(58, v.unit);
    if (v.from != v.value) column(68, v.from);
    line.erase(line.find_last_not_of(' ') + 1);
    say("%s\n", line.c_str());
  }
}

void print_report(const SheetReport& report, const std::string& machine_class,
                  const std::string& out) {
  print_values("given", report.given);
  print_values("worked out", report.derived);
  print_values(("guessed, typical of " + machine_class).c_str(), report.guessed);
  if (!report.missing.empty()) say("missing\n");
  for (const SheetReport::Missing& m : report.missing)
    say("  %-40s %s\n", (m.section + "." + m.key).c_str(), m.costs.c_str());
  say("written to %s\n", out.c_str());
  say("next: %s\n", idling_step(out).c_str());
}

/// The command line that stands for answers.
std::string without_questions(const SheetAnswers& sheet, const std::string& out) {
  const auto quoted = [](const std::string& text) {
    std::string safe = "'";
    for (const char c : text) c == '\'' ? safe += "'\\''" : safe += c;
    return safe + "'";
  };
  std::string line = "servosense init --out " + quoted(out);
  if (!sheet.machine_class.empty()) line += " --class " + sheet.machine_class;
  for (const SheetEntry& entry : sheet.entries)
    line += " --set " + quoted(entry.section + "." + entry.name + "=" + entry.text);
  return line;
}

int run_init(const Arguments& arguments) {
  const std::string& out = arguments.at("--out");
  SheetAnswers sheet{{}, arguments.value("--class").value_or("")};
  std::vector<std::string> faults;
  for (const std::string& text : arguments.all("--set")) {
    auto entry = sheet_entry_from(text);
    if (entry)
      sheet.entries.push_back(std::move(*entry));
    else
      faults.push_back("--set: " + entry.error().sentence);
  }
  const bool asks = !arguments.has("--set") && !arguments.json() && !arguments.quiet() &&
                    isatty(STDIN_FILENO) != 0;
  if (asks) {
    sheet = ask_sheet(std::cin, std::cerr, sheet.machine_class);
    note("the same without questions: " + without_questions(sheet, out));
  }
  const SheetReport report = work_out(sheet.entries, sheet.machine_class, out);
  faults.insert(faults.end(), report.faults.begin(), report.faults.end());
  if (faults.empty())
    if (std::string refused = refusal(report.machine); !refused.empty())
      faults.push_back(std::move(refused));
  if (!faults.empty()) {
    std::string all;
    for (const std::string& fault : faults) all += (all.empty() ? "" : "\n") + fault;
    return fail(usage_error(std::move(all)));
  }
  if (auto done = report.machine.write(out); !done) return fail(done.error());
  for (const std::string& remark : report.remarks) note(remark, arguments.quiet());
  if (arguments.json())
    print_json(report, sheet.machine_class, out);
  else
    print_report(report, sheet.machine_class, out);
  return 0;
}

std::string notes() {
  std::string text =
      "VALUE is a number with its unit, or without one in the unit of the key: lead_m=10mm,\n"
      "\"inertia_kg_m2=12 kg cm2\", encoder_counts_per_rev=20bit (or 5000 lines). Keys are those "
      "of\n"
      "docs/files.md. Without a --set the figures are asked for on a terminal, one by one.\n"
      "Beside keys there are figures of which keys are worked out:\n\n";
  char row[200];
  for (const MachineKey& figure : sheet_figures()) {
    const std::string drives = figure.family == "drive"    ? "drives"
                               : figure.family == "linear" ? "axis.x"
                                                           : "spindle";
    const std::string unit(figure.unit.empty() ? figure.choices : figure.unit);
    std::snprintf(row, sizeof row, "  %-8s %-22s %-9s %s\n", drives.c_str(),
                  std::string(figure.name).c_str(), unit.c_str(),
                  std::string(figure.meaning).c_str());
    text += row;
  }
  text += "\nClasses, whose typical inertia and friction stand where nothing else is known:\n\n";
  for (const MachineClass& c : machine_classes()) {
    std::snprintf(row, sizeof row, "  %-18s %s\n", std::string(c.name).c_str(),
                  std::string(c.meaning).c_str());
    text += row;
  }
  text.pop_back();
  return text;
}

}  // namespace

Program init_program() {
  return {{"init",
           "a machine file from data sheets",
           {{"--out", "FILE", "machine file to write", true, FileUse::output},
            {"--set",
             "SECTION.KEY=VALUE",
             "a figure of a data sheet, in any unit; may be repeated",
             false,
             FileUse::none,
             {},
             true},
            {"--class", "NAME", "guess inertia and friction typical of such machines"}},
           "",
           notes()},
          run_init};
}

}  // namespace servosense::cli
