// Quantiles of the normal and of Student's distribution.
#pragma once

#include <cmath>

namespace servosense {

/// Of the standard normal distribution (Abramowitz and Stegun 1964, 26.2.23, to 4.5e-4).
inline double normal_quantile(double upper_tail) {
  const double t = std::sqrt(-2 * std::log(upper_tail));
  return t - (2.515517 + t * (0.802853 + t * 0.010328)) /
                 (1 + t * (1.432788 + t * (0.189269 + t * 0.001308)));
}
/// Of Student's distribution (Abramowitz and Stegun 1964, 26.7.5).
inline double student_quantile(double upper_tail, double degrees) {
  const double z = normal_quantile(upper_tail), z2 = z * z, n = degrees;
  return z * (1 + (z2 + 1) / (4 * n) + ((5 * z2 + 16) * z2 + 3) / (96 * n * n) +
              (((3 * z2 + 19) * z2 + 17) * z2 - 15) / (384 * n * n * n));
}

}  // namespace servosense
