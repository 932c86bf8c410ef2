// What machines do, quantity by quantity: a column beyond it is in another unit than supposed.
#pragma once

#include "servosense/core/channel.hpp"

namespace servosense {

/// In the unit of the quantity. Nothing a machine does lies outside.
struct QuantityRange {
  double least = 0;
  double greatest = 0;
  const char* kind = "";    ///< "convention", "stated by makers"
  const char* source = "";  ///< where the bounds come from
};
[[nodiscard]] QuantityRange range_of(Quantity quantity);

/// Steps of time between rows [s]: drive records come at 200 kHz at most, and once a minute at
/// least. Convention: oscilloscopes of drives state up to 32 kHz, measuring cards 100 kHz.
inline constexpr double kShortestPeriod_s = 5e-6;
inline constexpr double kLongestPeriod_s = 60;

}  // namespace servosense
