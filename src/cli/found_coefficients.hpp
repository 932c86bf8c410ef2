// What the cutting coefficients monitor has found, for summary and JSON.
#pragma once

#include <string>
#include <vector>

#include "servosense/io/json.hpp"
#include "servosense/monitors/machine_stack.hpp"

namespace servosense::cli {

struct FoundCoefficient {
  std::string name, unit;
  double value = 0, standard_error = 0;
  bool told = false;  ///< the cuts of the record have told it
  std::string why;    ///< it is not told
};

/// In the order of the page; empty where the monitor does not run.
[[nodiscard]] std::vector<FoundCoefficient> found_coefficients(const MachineStack& stack);
void print(const std::vector<FoundCoefficient>& found);
void write(JsonWriter& json, const FoundCoefficient& found);

}  // namespace servosense::cli
