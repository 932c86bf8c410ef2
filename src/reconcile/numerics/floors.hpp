// Noise floors: what no model of the motion can explain.
#pragma once

#include "servosense/reconcile/criteria.hpp"
#include "servosense/reconcile/problem.hpp"

namespace servosense::reconcile {

/// Noise floors of a residual over the rows of a problem.
[[nodiscard]] Floors floors_of(const Problem& problem, const Column& residual,
                               const Criteria& criteria);

}  // namespace servosense::reconcile
