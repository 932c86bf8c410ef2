// Order statistics of a few values; 0 of none.
#pragma once

#include "servosense/reconcile/problem.hpp"

namespace servosense::reconcile {

/// Value that this share of them does not exceed.
[[nodiscard]] double quantile(Column values, double share);
/// The upper one of two.
[[nodiscard]] double median(Column values);

}  // namespace servosense::reconcile
