// Modes of a dynamometer from its own frequency response: an impact hammer on it, measured over
// applied force.
#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/model/dynamometer_mode.hpp"

namespace servosense {

struct DynamometerFit {
  std::vector<DynamometerMode> modes;            ///< by rising frequency
  std::vector<DynamometerMode> standard_errors;  ///< of each, number by number
  double static_gain = 1;  ///< of what was measured; the modes are of unit gain
  double misfit = 0;  ///< rms over the lines of |measured / fitted - 1|, each weighed as in the fit
  double from_hz = 0, to_hz = 0;  ///< lines used
};

struct DynamometerFitOptions {
  std::size_t modes = 0;  ///< 0: as many, up to 5, as the response shows
  double from_hz = 0, to_hz = 1e9;
  /// Rate of an exponential window that the response was measured with: it is that at s = rate +
  /// jw.
  double exponential_window_per_s = 0;
};

/// Least squares of H(s) = s0 (1 - sum c_k + sum c_k w_k^2 / (s^2 + 2 z_k w_k s + w_k^2))
/// (Dunwoody 2010, eq. 5.1 to 5.6): natural frequencies and damping ratios by Levenberg and
/// Marquardt, shares and static gain linear within. A line counts by 1 / |H|, since the force is
/// found through the inverse. A mode more is taken while it leaves less than 0.7 of the squares.
/// Standard errors are those of the inverse Hessian, times what is left, and as that is alike from
/// line to line (a window, or modes that the model lacks).
/// `response` measured over applied force [1] at rising `frequency_hz`; lines that are not finite
/// are passed over. Data error where fewer than 20 lines are left, or no mode is seen.
Expected<DynamometerFit> fit_dynamometer_modes(std::span<const double> frequency_hz,
                                               std::span<const std::complex<double>> response,
                                               const DynamometerFitOptions& options = {});

}  // namespace servosense
