// Typical values of classes of machines, for what no data sheet gives: inertia and friction. They
// are guesses, good to a factor of two or three, and 'servosense identify idle' replaces every one
// of them.
#pragma once

#include <span>
#include <string_view>

namespace servosense {

struct MachineClass {
  std::string_view name;
  std::string_view meaning;
};
struct TypicalValue {
  std::string_view machine_class;
  std::string_view section;
  std::string_view key;
  double value = 0;         ///< in the unit of the key
  std::string_view source;  ///< where it comes from, or how it is reasoned
};

[[nodiscard]] std::span<const MachineClass> machine_classes();
[[nodiscard]] std::span<const TypicalValue> typical_values();

}  // namespace servosense
