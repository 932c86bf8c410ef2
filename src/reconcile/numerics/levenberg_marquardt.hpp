// Nonlinear least squares within bounds.
#pragma once

#include <Eigen/Dense>
#include <functional>
#include <vector>

namespace servosense::reconcile {

struct BoundedParameter {
  double low = 0, high = 0;
  double step = 0;  ///< of the forward difference; backward where it would leave the bounds
};

struct NonlinearFit {
  std::vector<double> values;
  Eigen::VectorXd residual;
  Eigen::MatrixXd normal;  ///< slope' slope of the last round; empty without a round
};

/// Least squares over the parameters by Levenberg (1944) and Marquardt (1963), from `start`, in at
/// most so many `rounds`; ends early when a round gains less than the share `settled` of the sum of
/// squares. A residual that is not finite counts as no better.
[[nodiscard]] NonlinearFit levenberg_marquardt(
    const std::function<Eigen::VectorXd(const std::vector<double>&)>& residual_of,
    std::vector<double> start, const std::vector<BoundedParameter>& parameters, int rounds,
    double settled);

}  // namespace servosense::reconcile
