#include "reconcile/report/machine_file.hpp"

#include <array>
#include <cstdlib>
#include <span>
#include <vector>

#include "servosense/io/text.hpp"

namespace servosense::reconcile {

double rounded(double value) { return std::strtod(printed(value, 8).c_str(), nullptr); }

std::string error_note(double standard_error, int digits) {
  return "+- " + printed(standard_error, digits) + " (standard error)";
}

void set_effect(MachineFile& machine, const std::string& section, const FoundEffect& effect,
                const std::string& provenance, const std::string& gap_unit, int error_digits) {
  for (std::size_t p = 0; p < effect.parameters.size(); ++p) {
    const NamedValue& v = effect.parameters[p];
    if (!v.text.empty()) {
      machine.set(section, v.key, v.text);
    } else if (v.key == "profile") {
      std::vector<std::array<double, 2>> pairs;
      for (std::size_t k = 0; k + 1 < v.values.size(); k += 2)
        pairs.push_back({rounded(v.values[k]), rounded(v.values[k + 1])});
      machine.set(section, v.key, std::span<const std::array<double, 2>>(pairs));
    } else if (v.values.size() == 1) {
      const double error =
          p < effect.standard_errors.size() ? effect.standard_errors[p].values[0] : 0.0;
      machine.set(section, v.key, rounded(v.values[0]), error_note(error, error_digits));
    } else {
      std::vector<double> values;
      for (const double x : v.values) values.push_back(rounded(x));
      machine.set(section, v.key, std::span<const double>(values));
    }
  }
  machine.set(section, "provenance",
              provenance + ", confidence " + printed(effect.confidence) + ", gap " +
                  printed(effect.gap_before) + " to " + printed(effect.gap_after) + " " +
                  (effect.gap_unit.empty() ? gap_unit : effect.gap_unit));
}

}  // namespace servosense::reconcile
