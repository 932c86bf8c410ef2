#include "found_coefficients.hpp"

#include <cmath>
#include <filesystem>

#include "console.hpp"
#include "servosense/io/coefficient_file.hpp"
#include "written_coefficients.hpp"

namespace servosense::cli {

namespace {

constexpr const char* kOneFeed =
    "the feed per tooth has varied too little to tell chip and edge apart: the specific force at "
    "that feed is told";
constexpr const char* kHidden =
    "feeds that vary too little, axes that stand or their friction hide it";

struct NameOfCoefficient {
  const char *name, *unit, *why_not;
};
constexpr std::array<NameOfCoefficient, kFoundCoefficients> kNames = {
    {{"specific_force", "N/m2", "too few revolutions of cut"},
     {"force_ratio", "1", "the tool's first revolutions are being taught"},
     {"K_tc", "N/m2", kOneFeed},
     {"K_te", "N/m", kOneFeed},
     {"K_rc", "N/m2", kHidden},
     {"K_re", "N/m", kHidden},
     {"radial_ratio", "1", kHidden}}};

std::array<CuttingEstimate<double>, kFoundCoefficients> estimates_of(
    const CuttingCoefficients<double>& monitor) {
  return {monitor.specific_force(), monitor.force_ratio(),  monitor.coefficient(0),
          monitor.coefficient(1),   monitor.coefficient(2), monitor.coefficient(3),
          monitor.radial_ratio()};
}

}  // namespace

std::vector<FoundCoefficient> found_coefficients(const MachineStack& stack) {
  const CuttingCoefficients<double>* monitor = stack.coefficients();
  std::vector<FoundCoefficient> all;
  if (monitor == nullptr) return all;
  const bool cut = monitor->state().slots > 0;
  const auto estimates = estimates_of(*monitor);
  for (std::size_t i = 0; i < kFoundCoefficients; ++i) {
    const CuttingEstimate<double>& e = estimates[i];
    all.push_back({kNames[i].name, kNames[i].unit, e.value, e.error, e.told,
                   e.told ? ""
                   : cut  ? kNames[i].why_not
                          : "nothing was cut well inside a straight pass"});
  }
  return all;
}

void keep(CoefficientHistory& history, const MachineStack& stack, double t_s) {
  const CuttingCoefficients<double>* monitor = stack.coefficients();
  if (monitor == nullptr) return;
  const auto& state = monitor->state();
  if (state.changes > history.found_changes && history.changes.size() < history.kMostChanges)
    history.changes.push_back({t_s, state.change});
  history.found_changes = state.changes;
  if (state.slots == history.slots) return;
  history.slots = state.slots;
  history.taught_N_per_m2 = state.taught_N_per_m2;
  if (history.slots % history.every != 0) return;
  history.points.push_back({t_s, estimates_of(*monitor)});
  if (history.points.size() < history.kMostPoints) return;
  for (std::size_t i = 1; 2 * i < history.points.size(); ++i)
    history.points[i] = history.points[2 * i];
  history.points.resize(history.points.size() / 2);
  history.every *= 2;
}

Expected<Done> write_found_coefficients(const std::string& path, const MachineFile& machine,
                                        const std::vector<FoundCoefficient>& found,
                                        const std::string& trace, std::uint64_t revolutions,
                                        std::vector<std::string>& remarks) {
  if (found.empty())
    return data_error(path +
                      ": not written, as the coefficients are not followed; write "
                      "[monitor.cutting-coefficients] into the machine file, and see why it does "
                      "not run where it stands there");
  const FoundCoefficient& force = found[kSpecificForce];
  if (!force.told) return data_error(path + ": not written: " + force.why);
  const auto of = [](const FoundCoefficient& f) { return Estimate{f.value, f.standard_error}; };
  std::vector<NamedCoefficient> named = {
      {"tangential_coefficient_N_per_m2", "N/m2", of(found[kTangential])},
      {"tangential_edge_N_per_m", "N/m", of(found[kTangentialEdge])}};
  if (!found[kTangential].told)
    remarks.push_back(path + ": K_tc and K_te hold together at the feed of the cuts alone, as " +
                      found[kTangential].why);
  const auto joined = with_coefficients(machine);
  if (!joined) return joined.error();
  const auto add = [&](const char* key, const char* unit, const FoundCoefficient& f) {
    if (f.told) return named.push_back({key, unit, of(f)});
    const auto before = joined->number("tool", key);
    if (!before) return;
    named.push_back({key, unit, {*before, std::nan("")}});
    remarks.push_back(path + ": " + key + " is that of the machine file: " + f.why);
  };
  add("radial_ratio", "", found[kRadialRatio]);
  add("radial_edge_N_per_m", "N/m", found[kRadialEdge]);
  const FoundCoefficient axial{"", "", 0, 0, false, "the axes x and y do not tell it"};
  add("axial_coefficient_N_per_m2", "N/m2", axial);
  add("axial_edge_N_per_m", "N/m", axial);
  return write_coefficient_file(
      path, machine, named,
      "servosense monitor: " + std::filesystem::path(trace).filename().string() + " (" +
          std::to_string(revolutions) + " revolutions of cut)",
      remarks);
}

void print(const std::vector<FoundCoefficient>& found) {
  for (const FoundCoefficient& f : found) {
    const std::string unit = f.unit == "1" ? "" : " " + f.unit;
    if (f.told)
      say("  %-14s %.4g +- %.2g%s (95 %%)\n", f.name.c_str(), f.value, 1.96 * f.standard_error,
          unit.c_str());
    else
      say("  %-14s not told: %s\n", f.name.c_str(), f.why.c_str());
  }
  if (!found.empty()) say("\n");
}

void write(JsonWriter& json, const FoundCoefficient& f) {
  const double half = 1.96 * f.standard_error;
  json.member("name", f.name);
  json.member("unit", f.unit);
  json.member("told", f.told);
  json.member("value", f.told ? f.value : std::nan(""));
  json.member("standard_error", f.told ? f.standard_error : std::nan(""));
  json.member("low", f.told ? f.value - half : std::nan(""));
  json.member("high", f.told ? f.value + half : std::nan(""));
  if (!f.told) json.member("reason", f.why);
}

}  // namespace servosense::cli
