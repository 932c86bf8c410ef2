// How the tool answered one blow, and how long that lasts.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace servosense::impact {

/// From the begin of a hit's segment on, as long as the record or the time to the next blow allows.
struct Response {
  std::vector<double> x;  ///< offset and drift removed
  double quiet = 0;       ///< rms before the blow; NaN when fewer than 16 samples are there
  double tail = 0;        ///< rms of the last tenth, about its mean
  double highest = 0;     ///< rms of the strongest block
  double wander = 0;      ///< rms of the means of the tenths in which it is over: a zero that moves
  std::size_t block = 0;  ///< samples of a block
  std::size_t lasts = 0;  ///< samples until it stays below a hundredth of that, or in the noise

  /// rms of the last tenth of its first `length` samples over the highest, noise taken off.
  [[nodiscard]] double left(std::size_t length, double noise) const;
  /// What the sum over all samples behind those may be: three times their rms over the angle in rad
  /// by which they go on from sample to sample.
  [[nodiscard]] double beyond(std::size_t length, double noise) const;
};

/// `before`: samples of rest up to the segment, `after`: from there on.
[[nodiscard]] Response response_of(std::span<const double> before, std::span<const double> after,
                                   double sample_rate_hz);

}  // namespace servosense::impact
