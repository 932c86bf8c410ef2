// A count from a quantity: how many samples a time is, how many counts an angle is.
#pragma once

#include <cstdint>

namespace servosense {

/// `x` rounded down, 0 where it is negative or no number, 4294967295 where it is larger: what comes
/// out of a configuration may be any double, and a plain cast of what does not fit is undefined.
[[nodiscard]] constexpr std::uint32_t whole(double x) noexcept {
  constexpr double kLargest = 4294967295.0;
  return x >= kLargest ? 4294967295U : x > 0 ? static_cast<std::uint32_t>(x) : 0U;
}

/// The nearest, likewise.
[[nodiscard]] constexpr std::uint32_t nearest_whole(double x) noexcept { return whole(x + 0.5); }

}  // namespace servosense
