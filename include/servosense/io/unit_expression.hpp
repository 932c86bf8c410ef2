// Units made of others, as data sheets and machine files print them: "kg cm2", "Nm/Arms",
// "V/1000 rpm". The parts are those of unit_name.hpp and some that only data sheets use.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

namespace servosense {

/// How an alternating current or voltage is told.
enum class Amplitude : std::uint8_t {
  unsaid,
  effective,  ///< "rms", "eff"
  peak        ///< "pk", "peak"
};

/// Of metre, kilogram, second, ampere, kelvin, radian, count, bit, line of an encoder.
using UnitPowers = std::array<int, 9>;

struct UnitExpression {
  double value = 1;  ///< of one such unit in those of UnitPowers
  UnitPowers powers{};
  Amplitude amplitude = Amplitude::unsaid;
};

/// Whatever `text` may mean, the most usual first: "g" is an acceleration and a mass, "1/min" a
/// speed and a rate. Empty where a part of it is no known unit; "" is a plain number. Parts stand
/// side by side or with a sign of multiplication, a stroke or "per" divides by the part behind it,
/// a power of ten may stand there; powers are digits.
[[nodiscard]] std::vector<UnitExpression> unit_expressions(std::string_view text);

}  // namespace servosense
