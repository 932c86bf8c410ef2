// Cutter radius compensation: G40, G41, G42, G41.1, G42.1.
#include <cmath>

#include "machine.hpp"
#include "servosense/io/text.hpp"

namespace servosense::process {

void Machine::flush() {
  for (const CanonicalMove& move : open_) sink_(move);
  open_.clear();
}

Refusal Machine::compensation(const Block&, int code) {
  if (code == 400) return compensation_off();
  return refuse("cutter compensation is not supported; have the path of the tool's centre put out");
}

Refusal Machine::compensation_off() { return std::nullopt; }
Refusal Machine::compensated_straight(const Block&, int, const AxisPoint&) { return std::nullopt; }
Refusal Machine::compensated_arc(const Block&, int, const AxisPoint&) { return std::nullopt; }

}  // namespace servosense::process
