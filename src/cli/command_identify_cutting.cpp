// servosense identify cutting: cutting coefficients from test cuts.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <limits>
#include <string>
#include <vector>

#include "commands.hpp"
#include "console.hpp"
#include "cutting_records.hpp"
#include "estimate_text.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/cutting.hpp"
#include "servosense/io/coefficient_file.hpp"
#include "servosense/io/json.hpp"
#include "written_coefficients.hpp"

namespace servosense::cli {
namespace {

std::vector<NamedCoefficient> coefficients_of(const CuttingIdentification& found) {
  std::vector<NamedCoefficient> all = {
      {"tangential_coefficient_N_per_m2", "N/m2", found.tangential_N_per_m2},
      {"tangential_edge_N_per_m", "N/m", found.tangential_edge_N_per_m}};
  if (found.radial_ratio) all.push_back({"radial_ratio", "", *found.radial_ratio});
  if (found.radial_edge_N_per_m)
    all.push_back({"radial_edge_N_per_m", "N/m", *found.radial_edge_N_per_m});
  if (found.axial_N_per_m2)
    all.push_back({"axial_coefficient_N_per_m2", "N/m2", *found.axial_N_per_m2});
  if (found.axial_edge_N_per_m)
    all.push_back({"axial_edge_N_per_m", "N/m", *found.axial_edge_N_per_m});
  return all;
}

/// Mean torque of a cut, of the first torque of its record.
CutMean torque_of(const FoundCut& cut, const std::vector<CuttingRecord>& records) {
  const std::vector<CuttingSignal>& signals = records[cut.record].signals;
  const bool known = !cut.means.empty() && signals[0].kind == CuttingSignal::Kind::torque;
  const double none = std::numeric_limits<double>::quiet_NaN();
  return known ? cut.means[0] : CutMean{none, none};
}

/// "identify cutting: a.csv (3 cuts), b.csv (2 cuts), by spindle.load_V"
std::string provenance_of(const CuttingIdentification& found,
                          const std::vector<CuttingRecord>& records) {
  std::string text = "servosense identify cutting:";
  for (std::size_t r = 0; r < records.size(); ++r) {
    int cuts = 0;
    for (const FoundCut& cut : found.cuts) cuts += cut.record == r && cut.used && !cut.air ? 1 : 0;
    text += (r > 0 ? ", " : " ") + std::filesystem::path(records[r].name).filename().string() +
            " (" + std::to_string(cuts) + (cuts == 1 ? " cut)" : " cuts)");
  }
  return text + ", by " + found.sensors.front().sensor;
}

void print_json(const CuttingIdentification& found, const std::vector<CuttingRecord>& records,
                const std::vector<std::string>& remarks, const Arguments& arguments) {
  JsonWriter json(std::cout, 2);
  json.begin_object();
  for (const NamedCoefficient& c : coefficients_of(found)) {
    json.member(c.key, c.estimate.value);
    json.member(std::string(c.key) + "_standard_error", c.estimate.standard_error);
  }
  json.member("tangential_edge_held", found.edge_held);
  json.member("sensor", found.sensors.front().sensor);
  json.member("misfit", found.misfit);
  const auto stretch = [&](const FoundCut& cut) {
    json.member("trace", records[cut.record].name);
    json.member("from_s", cut.from_s);
    json.member("to_s", cut.to_s);
    json.member("spindle_speed_rpm", rpm_from_rad_s(std::abs(cut.speed_rad_s)));
    const CutMean torque = torque_of(cut, records);
    json.member("mean_torque_Nm", torque.value);
    json.member("mean_torque_standard_error", torque.standard_error);
  };
  json.key("cuts");
  json.begin_array();
  for (const FoundCut& cut : found.cuts) {
    if (cut.air) continue;
    json.begin_object();
    stretch(cut);
    json.member("feed_per_tooth_m", cut.feed_per_tooth_m);
    json.member("used", cut.used);
    json.member("reason", cut.reason);
    json.end_object();
  }
  json.end_array();
  json.key("air");
  json.begin_array();
  for (const FoundCut& cut : found.cuts) {
    if (!cut.air) continue;
    json.begin_object();
    stretch(cut);
    json.end_object();
  }
  json.end_array();
  json.objects("sensors", found.sensors, [&](const SensorCoefficients& s) {
    json.member("sensor", s.sensor);
    json.member("tangential_coefficient_N_per_m2", s.tangential_N_per_m2.value);
    json.member("tangential_coefficient_N_per_m2_standard_error",
                s.tangential_N_per_m2.standard_error);
    json.member("tangential_edge_N_per_m", s.tangential_edge_N_per_m.value);
    json.member("tangential_edge_N_per_m_standard_error", s.tangential_edge_N_per_m.standard_error);
  });
  json.values("remarks", remarks);
  if (const auto out = arguments.value("--out")) json.member("out", *out);
  if (const auto file = arguments.value("--coefficients")) json.member("coefficients", *file);
  json.end_object();
  std::cout << '\n';
}

void print_text(const CuttingIdentification& found, const std::vector<CuttingRecord>& records,
                const Arguments& arguments) {
  say("%-14s %8s %8s %7s %9s %10s\n", "trace", "from s", "to s", "rpm", "mm/tooth", "Nm");
  for (const FoundCut& cut : found.cuts) {
    const CutMean torque = torque_of(cut, records);
    const std::string name = std::filesystem::path(records[cut.record].name).filename().string();
    char feed[32] = "air";
    if (!cut.air) std::snprintf(feed, sizeof feed, "%.4g", 1e3 * cut.feed_per_tooth_m);
    say("%-14s %8.3f %8.3f %7.0f %9s %10.4g%s%s\n", name.c_str(), cut.from_s, cut.to_s,
        rpm_from_rad_s(std::abs(cut.speed_rad_s)), feed, torque.value,
        cut.used ? "" : "  not used: ", cut.reason.c_str());
  }
  say("by %s\n", found.sensors.front().sensor.c_str());
  for (const NamedCoefficient& c : coefficients_of(found)) {
    std::string name(c.key);
    const std::size_t unit = name.find("_N_per_m");
    name = name.substr(0, unit);
    for (char& letter : name)
      if (letter == '_') letter = ' ';
    print_row(name.c_str(), c.estimate, c.unit);
  }
  if (const auto file = arguments.value("--coefficients"))
    say("coefficients written to %s\n", file->c_str());
  if (const auto out = arguments.value("--out")) say("written to %s\n", out->c_str());
}

/// What --out and --coefficients ask for.
Expected<Done> write_files(MachineFile& machine, const CuttingIdentification& found,
                           const std::string& provenance, const Arguments& arguments,
                           std::vector<std::string>& remarks) {
  const auto out = arguments.value("--out"), apart = arguments.value("--coefficients");
  if (apart) {
    auto done =
        write_coefficient_file(*apart, machine, coefficients_of(found), provenance, remarks);
    if (!done) return done.error();
  }
  if (!out) return Done{};
  machine.remove("tool", "coefficients");
  if (apart) {
    for (const char* key : kCoefficientKeys) machine.remove("tool", key);
    machine.remove("tool", "provenance");
    const auto beside = std::filesystem::path(*out).parent_path();
    auto name = std::filesystem::absolute(*apart).lexically_relative(
        std::filesystem::absolute(beside.empty() ? "." : beside));
    machine.set("tool", "coefficients", name.lexically_normal().string());
  } else {
    write_coefficients(machine, coefficients_of(found), provenance, remarks);
  }
  return machine.write(*out);
}

int run_identify_cutting(const Arguments& arguments) {
  auto machine = MachineFile::read(arguments.at("--machine"));
  if (!machine) return fail(machine.error());
  const std::vector<std::string>& traces = arguments.operands();
  if (traces.empty())
    return fail(usage_error("give one trace or more of test cuts at two feeds or more"));
  auto geometry = cut_geometry(*machine);
  if (!geometry) return fail(geometry.error());
  CuttingOptions options;
  options.tangential_edge_N_per_m = machine->number("tool", "tangential_edge_N_per_m");
  std::vector<std::string> remarks;
  std::vector<CuttingRecord> records;
  {
    Progress progress("reading", arguments.quiet());
    for (const std::string& path : traces) {
      auto record = read_cutting_record(path, *machine, progress, remarks);
      if (!record) return fail(record.error());
      records.push_back(std::move(*record));
    }
  }
  auto found = identify_cutting(*geometry, records, options);
  if (!found)
    return fail(Error{
        found.error().kind,
        traces.front() + (traces.size() > 1 ? " and others" : "") + ": " + found.error().sentence});
  for (const std::string& remark : found->remarks) remarks.push_back(remark);
  if (auto done = write_files(*machine, *found, provenance_of(*found, records), arguments, remarks);
      !done)
    return fail(done.error());
  std::sort(remarks.begin(), remarks.end());
  remarks.erase(std::unique(remarks.begin(), remarks.end()), remarks.end());
  for (const std::string& remark : remarks) note(remark, arguments.quiet());
  if (arguments.json())
    print_json(*found, records, remarks, arguments);
  else
    print_text(*found, records, arguments);
  return 0;
}

}  // namespace

Program identify_cutting_program() {
  return {
      {"identify cutting",
       "cutting coefficients of a tool and material, from test cuts",
       {{"--machine", "FILE", "machine file, with [tool] and [cut]", true, FileUse::input},
        {"--out", "FILE", "machine file to write, with what was found", false, FileUse::renewed},
        {"--coefficients", "FILE",
         "coefficient file to write, for [tool] coefficients of machine files", false,
         FileUse::renewed}},
       "TRACE...",
       "Cut at two feeds per tooth or more that differ by a factor of two, of one depth and\n"
       "width, a second each, with air of the same speed before or after. The cuts are found\n"
       "by themselves. Axes tell the radial coefficients, a dynamometer all of them."},
      run_identify_cutting};
}

}  // namespace servosense::cli
