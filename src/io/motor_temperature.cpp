#include "servosense/io/motor_temperature.hpp"

#include <algorithm>

#include "servosense/io/text.hpp"

namespace servosense {
namespace {

// A motor warms with a time constant of many minutes: in half a minute its constant moves by
// less than it is known to.
constexpr double kHeld_s = 30;

}  // namespace

std::string MotorTemperature::missing(Channel drive, double at_C) const {
  const std::string who(name_of(drive)), column = who + ".temperature_C";
  const std::string stated = "torque per ampere is taken as at " + printed(at_C, 3) + " degC";
  if (!known()) return who + ": " + column + " has no value; " + stated;
  std::string said;
  if (const double before = first_s_ - first_row_s_; before > kHeld_s)
    said = column + " has no value in the first " + printed(before, 3) + " s: there " + stated;
  if (const double held = std::max(longest_s_, now_s_ - last_s_); held > kHeld_s)
    said += (said.empty() ? "" : "; ") + column + " is missing for " + printed(held, 3) +
            " s: its last value is held";
  return said.empty() ? said : who + ": " + said;
}

}  // namespace servosense
