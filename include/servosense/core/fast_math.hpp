// Sine, cosine and exponential in a fixed number of arithmetic operations, for the servo rate.
//
// Polynomials on a reduced range, no table, no branch that depends on the result. Absolute error
// below 2e-7 in float (the rounding of float itself), below 1e-9 in double: use <cmath> off the
// real-time path.
#pragma once

#include <bit>
#include <cstdint>

#include "servosense/core/real_time.hpp"

namespace servosense {

/// exp(-x) for x >= 0; 0 beyond x = 80. Relative error below 3e-7.
template <RealNumber Real>
[[nodiscard]] constexpr Real exp_negative(Real x) noexcept {
  if (!(x < Real(80))) return Real(0);
  // exp(-x) = 2^-n * exp(-f), f in [-ln2/2, ln2/2]
  const Real scaled = x * Real(1.4426950408889634);
  const auto n = static_cast<std::int32_t>(scaled + Real(0.5));
  const Real f = (static_cast<Real>(n) - scaled) * Real(0.6931471805599453);
  const Real series =
      Real(1) +
      f * (Real(1) + f * (Real(0.5) +
                          f * (Real(1.0 / 6) + f * (Real(1.0 / 24) +
                                                    f * (Real(1.0 / 120) + f * Real(1.0 / 720))))));
  return series *
         static_cast<Real>(std::bit_cast<float>(static_cast<std::uint32_t>(127 - n) << 23U));
}

template <RealNumber Real>
struct SineCosine {
  Real sine;
  Real cosine;
};

/// Sine and cosine of an angle in [-2 pi, 4 pi] rad.
template <RealNumber Real>
[[nodiscard]] constexpr SineCosine<Real> sine_cosine(Real angle) noexcept {
  // Quarter turns to the nearest, remainder in [-pi/4, pi/4] by a two-part pi/2 (Cody and Waite
  // 1980).
  const Real quarters = angle * Real(0.63661977236758134);
  const auto q = static_cast<std::int32_t>(quarters + (quarters < 0 ? Real(-0.5) : Real(0.5)));
  const Real n = static_cast<Real>(q);
  constexpr double kHalfPi = 1.57079632679489661923;
  constexpr float kHigh = 1.5703125F;  // exactly representable with room for the product
  const Real r = (angle - n * static_cast<Real>(kHigh)) -
                 n * static_cast<Real>(kHalfPi - static_cast<double>(kHigh));
  const Real r2 = r * r;
  const Real s =
      r + r * r2 *
              (Real(-1.0 / 6) +
               r2 * (Real(1.0 / 120) + r2 * (Real(-1.0 / 5040) + r2 * Real(1.0 / 362880))));
  const Real c =
      Real(1) +
      r2 * (Real(-0.5) +
            r2 * (Real(1.0 / 24) +
                  r2 * (Real(-1.0 / 720) + r2 * (Real(1.0 / 40320) - r2 * Real(1.0 / 3628800)))));
  const bool swap = (q & 1) != 0;
  const Real sine = swap ? c : s;
  const Real cosine = swap ? s : c;
  return {(q & 2) != 0 ? -sine : sine, ((q + 1) & 2) != 0 ? -cosine : cosine};
}

}  // namespace servosense
