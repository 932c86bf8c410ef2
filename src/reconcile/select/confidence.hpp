// How sure a name is.
#pragma once

#include <algorithm>
#include <cmath>

#include "servosense/reconcile/criteria.hpp"

namespace servosense::reconcile {

/// What an effect may be named on.
struct Evidence {
  double picked = 1;     ///< share of resampled records that give the name
  double explained = 1;  ///< share of what is beyond the noise, by all that is named
  /// Standard errors by which what stands against it is behind: the next best name, or that
  /// nothing is there.
  double margin = 0;
};

/// Probability that a name is right: that other data of the same kind would give it, that it does
/// not stand in for a part of what stays without a name, and that its rival is not ahead by chance
/// alone. No more than `largest_confidence`.
[[nodiscard]] inline double confidence_of(const Evidence& its, const Criteria& criteria) {
  constexpr double kOpen = 0.05;  // floors are known to some per cent
  const double ahead = 0.5 * std::erfc(-its.margin / std::sqrt(2.0));
  const double whole = std::clamp(its.explained + kOpen, 0.0, 1.0);
  return std::clamp(its.picked * whole * ahead, 0.0, criteria.largest_confidence);
}

}  // namespace servosense::reconcile
