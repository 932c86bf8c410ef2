#include "reconcile/select/compare.hpp"

#include <algorithm>
#include <cmath>

namespace servosense::reconcile {

double standard_errors_between(std::span<const double> worse, std::span<const double> better) {
  double sum = 0, square = 0;
  const auto n = static_cast<double>(worse.size());
  for (std::size_t b = 0; b < worse.size(); ++b) {
    const double d = worse[b] - better[b];
    sum += d;
    square += d * d;
  }
  const double variance = (square - sum * sum / n) * n / std::max(1.0, n - 1);
  return sum / std::sqrt(std::max(1e-300, variance));
}

}  // namespace servosense::reconcile
