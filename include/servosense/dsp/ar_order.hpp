// How long must an autoregressive model be? Final prediction error and information criterion.
//
// Purpose: chooses the order of the breakage monitor's model from a recording (off line).
//   s(p)   = sum of e_p(k)^2 over k = p_max+1 .. N, e_p the residual of order p
//   FPE(p) = (N' + p + 1) / (N' - p - 1) * s(p) / N'     (Akaike 1969)
//   AIC(p) = N' ln(s(p) / (N' - p - 1)) + 2 p            (Bertok 1984, eq. 3.20-3.21)
// N' = N - p_max: all orders are judged by the same samples. All residuals come from one pass of
// the lattice (dsp/lattice_ar.hpp) in double. Bertok's 3.20 prints the mean residual without
// Akaike's factor N + p + 1; AIC follows the print, FPE follows Akaike.
// Bad at: the curve of a periodic signal falls in steps where another revolution fits in, and the
// minimum may sit on noise far beyond the last step; look at the curve.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

struct ArOrderCurve {
  /// Index = order, from 0 (the signal itself).
  std::vector<double> variance, fpe, aic;
  std::size_t least_fpe = 0;  ///< orders of the minima
  std::size_t least_aic = 0;
};

/// Needs at least 3 (most_order + 1) samples, all of them numbers, order 1..256; `noise_variance`
/// is V of the model, above 0.
[[nodiscard]] Expected<ArOrderCurve> ar_order_curve(std::span<const double> samples,
                                                    std::size_t most_order, double noise_variance);

/// Orders at which the criterion stops falling for a while: the last of every group of falls by
/// more than four, which one coefficient that tells nothing causes once in forty times (chi-square
/// of one degree above 5). Bertok's fig. 3.6 read so gives 3, 11, 30 and 46.
[[nodiscard]] std::vector<std::size_t> candidate_orders(std::span<const double> aic);

}  // namespace servosense
