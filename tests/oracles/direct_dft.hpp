// Fourier lines by their definition, summed in long double.
#pragma once

#include <cmath>
#include <complex>
#include <cstddef>
#include <vector>

namespace oracle {

/// Sum of x[i] e^(-j h angle[i]); h need not be whole.
inline std::complex<double> direct_line(const std::vector<double>& x,
                                        const std::vector<double>& angle_rad, double h) {
  using Wide = long double;
  Wide real = 0;
  Wide imaginary = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Wide phase = Wide(h) * Wide(angle_rad[i]);
    real += Wide(x[i]) * std::cos(phase);
    imaginary -= Wide(x[i]) * std::sin(phase);
  }
  return {static_cast<double>(real), static_cast<double>(imaginary)};
}

/// Bin k of the unnormalised DFT.
inline std::complex<double> direct_bin(const std::vector<double>& x, std::size_t k) {
  std::vector<double> turn(x.size());
  for (std::size_t i = 0; i < x.size(); ++i)
    turn[i] = 2 * std::acos(-1.0) * static_cast<double>((i * k) % x.size()) /
              static_cast<double>(x.size());
  return direct_line(x, turn, 1);
}

}  // namespace oracle
