// How sure a name is.
#pragma once

#include <algorithm>
#include <cmath>

#include "servosense/reconcile/criteria.hpp"

namespace servosense::reconcile {

/// Probability that a name is right: that other data of the same kind would give it, `picked` of
/// resampled records or of the gap, and that what stands against it is behind by chance alone,
/// `margin` standard errors: the next best name, or that nothing is there. No more than
/// `largest_confidence`.
[[nodiscard]] inline double confidence_of(double picked, double margin, const Criteria& criteria) {
  const double ahead = 0.5 * std::erfc(-margin / std::sqrt(2.0));
  return std::clamp(picked * ahead, 0.0, criteria.largest_confidence);
}

}  // namespace servosense::reconcile
