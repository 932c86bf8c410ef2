// Where is it? The residual as a function of one coordinate after the other.
#pragma once

#include <vector>

#include "servosense/reconcile/options.hpp"
#include "servosense/reconcile/problem.hpp"
#include "servosense/reconcile/report.hpp"

namespace servosense::reconcile {

/// Share of the residual's variance that is a function of each coordinate, largest first.
[[nodiscard]] std::vector<ResidualMap> maps_of(const Problem& problem, const Column& residual,
                                               const Options& options);

}  // namespace servosense::reconcile
