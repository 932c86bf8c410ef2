// What an effect means for the machine, and what to do about it, in the words of maintenance.
#pragma once

#include <string_view>

namespace servosense::reconcile {

struct MaintenanceAdvice {
  std::string_view effect;
  std::string_view meaning;  ///< a clause: "the screw sticks before it slides"
  std::string_view remedy;   ///< another: "check the lubrication"
};

/// Empty texts for an effect that has none.
[[nodiscard]] MaintenanceAdvice maintenance_advice(std::string_view effect);

}  // namespace servosense::reconcile
