// The nonlinear parameters of a candidate: grid, then refinement.
#pragma once

#include <vector>

#include "reconcile/numerics/least_squares.hpp"

namespace servosense::reconcile {

struct Optimum {
  std::vector<double> theta;
  std::vector<Column> columns;  ///< at theta; empty when nothing was tried with success
  double mean_square = 0;
};

/// The grid, or what is read off a residual instead.
std::vector<std::vector<double>> starting_points(const Candidate& candidate,
                                                 const Column& residual);

/// Least mean square of target less known terms less candidate. `from`: refine this instead of
/// searching the grid. What the grid does not bring within sight of a gain of `worth` (mean square)
/// is not refined.
Optimum search(const Candidate& candidate, const Regression& known, const Column& residual,
               double worth = 0, const std::vector<double>* from = nullptr);

}  // namespace servosense::reconcile
