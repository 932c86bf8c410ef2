// A torque constant that falls with speed, seen in an idling run.
//
// The torque of inertia is the reference: at any speed, J a + D v + C is what the motor gives, so
// the current that it takes tells the constant. With the effect field-weakening,
//   i = c(|v|) (J a + D v + C),   c = (|v| / v_base)^n beyond base speed, or a table.
// The error lies in the current, so rows are fitted as they stand here: in units of torque a
// smaller constant would always look better.
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "idle_design.hpp"

namespace servosense::idle_fit {

struct FoundWeakening {
  Estimate base_speed;  ///< rad/s or m/s
  Estimate exponent;    ///< 1 +- 0 where the record does not tell it from constant power
  /// Speed and current per torque, where no power of the speed fits; else empty.
  std::vector<std::pair<double, Estimate>> table;
};

/// Nothing where the constant is the same at all speeds of the record, as far as it shows, or where
/// drag that grows with the square of speed explains as much. `columns`: what the effort is made
/// of.
std::optional<FoundWeakening> find_field_weakening(const IdleDesign& design,
                                                   const Columns& columns);

}  // namespace servosense::idle_fit
