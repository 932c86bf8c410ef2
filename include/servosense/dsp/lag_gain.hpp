// What a first order lag leaves of a sinusoid.
#pragma once

#include <cmath>

namespace servosense {

/// Amplitude behind a lag over that before it, at -3 dB of `cutoff_hz`; 1 without a lag (0).
[[nodiscard]] inline double lag_gain(double frequency_hz, double cutoff_hz) noexcept {
  const double ratio = cutoff_hz > 0 ? frequency_hz / cutoff_hz : 0;
  return 1 / std::sqrt(1 + ratio * ratio);
}
/// Where it leaves half.
[[nodiscard]] inline double lag_half_hz(double cutoff_hz) noexcept {
  return 1.7320508075688772 * cutoff_hz;
}

}  // namespace servosense
