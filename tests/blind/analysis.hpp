// The little signal analysis that the generator needs to say how strong a hidden effect is, and
// that the comparator builds on. Independent of the workflow under test.
#pragma once

#include <cstddef>
#include <vector>

namespace blind {

using Signal = std::vector<double>;

/// Zero-phase low-pass: Butterworth of second order there and back.
Signal low_pass(const Signal&, double rate_hz, double cutoff_hz);

/// Derivative by central differences, fourth order inside.
Signal derivative(const Signal&, double rate_hz);

/// Sign of the motion with a presliding travel: a clamped integral of the motion.
Signal soft_sign(const Signal& position, double knee);

/// The same with a travel that fades like an exponential (Dahl 1968).
Signal fading_sign(const Signal& position, double knee);

struct Fit {
  std::vector<double> coefficients;
  Signal residual;  ///< over all rows
};

/// target = sum coefficient * column over rows [from, to); the residual is of all rows.
Fit least_squares(const std::vector<Signal>& columns, const Signal& target, std::size_t from,
                  std::size_t to);

double rms(const Signal&, std::size_t from, std::size_t to);

}  // namespace blind
