#include "found_coefficients.hpp"

#include <cmath>

#include "console.hpp"

namespace servosense::cli {

std::vector<FoundCoefficient> found_coefficients(const MachineStack& stack) {
  const CuttingCoefficients<double>* monitor = stack.coefficients();
  std::vector<FoundCoefficient> all;
  if (monitor == nullptr) return all;
  const bool cut = monitor->state().slots > 0;
  const auto add = [&](const char* name, const char* unit, const CuttingEstimate<double>& e,
                       const char* why) {
    all.push_back({name, unit, e.value, e.error, e.told,
                   e.told ? ""
                   : cut  ? why
                          : "nothing was cut well inside a straight pass"});
  };
  add("specific_force", "N/m2", monitor->specific_force(), "too few revolutions of cut");
  add("force_ratio", "1", monitor->force_ratio(), "the tool's first revolutions are being taught");
  const char* one_feed =
      "the feed per tooth has varied too little to tell chip and edge apart: the specific force at "
      "that feed is told";
  const char* hidden = "feeds that vary too little, axes that stand or their friction hide it";
  add("K_tc", "N/m2", monitor->coefficient(0), one_feed);
  add("K_te", "N/m", monitor->coefficient(1), one_feed);
  add("K_rc", "N/m2", monitor->coefficient(2), hidden);
  add("K_re", "N/m", monitor->coefficient(3), hidden);
  add("radial_ratio", "1", monitor->radial_ratio(), hidden);
  return all;
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
