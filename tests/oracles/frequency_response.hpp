// Gain and phase of a block as a black box: its impulse response, transformed by definition.
#pragma once

#include <cmath>
#include <complex>
#include <cstddef>
#include <vector>

namespace oracle {

/// First `length` outputs of `step` for the input 1, 0, 0, ...
template <typename Step>
std::vector<double> impulse_response(Step&& step, std::size_t length) {
  std::vector<double> h(length);
  for (std::size_t n = 0; n < length; ++n) h[n] = static_cast<double>(step(n == 0 ? 1.0 : 0.0));
  return h;
}

/// Transform of an impulse response that has died away, at `angle_rad` per sample.
inline std::complex<double> response(const std::vector<double>& h, double angle_rad) {
  std::complex<long double> sum = 0;
  for (std::size_t n = 0; n < h.size(); ++n)
    sum += static_cast<long double>(h[n]) *
           std::polar(1.0L, -static_cast<long double>(angle_rad) * static_cast<long double>(n));
  return {static_cast<double>(sum.real()), static_cast<double>(sum.imag())};
}

}  // namespace oracle
