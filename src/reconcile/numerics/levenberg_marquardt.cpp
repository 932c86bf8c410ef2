#include "reconcile/numerics/levenberg_marquardt.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dsp/dense.hpp"

namespace servosense::reconcile {

NonlinearFit levenberg_marquardt(
    const std::function<Eigen::VectorXd(const std::vector<double>&)>& residual_of,
    std::vector<double> start, const std::vector<BoundedParameter>& parameters, int rounds,
    double settled) {
  constexpr int kAttempts = 6;  // to damp more before a round is given up
  NonlinearFit best;
  best.values = std::move(start);
  best.residual = residual_of(best.values);
  const auto n = static_cast<Eigen::Index>(parameters.size());
  double damping = 1e-2;
  for (int round = 0; round < rounds && n > 0; ++round) {
    Eigen::MatrixXd slope(best.residual.size(), n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      std::vector<double> moved = best.values;
      double step = parameters[k].step;
      if (moved[k] + step > parameters[k].high) step = -step;
      moved[k] += step;
      slope.col(i) = (residual_of(moved) - best.residual) / step;
    }
    best.normal = slope.transpose() * slope;
    const Eigen::VectorXd right = -(slope.transpose() * best.residual);
    const double floor = 1e-12 * best.normal.diagonal().maxCoeff();
    const double before = best.residual.squaredNorm();
    bool better = false;
    for (int attempt = 0; attempt < kAttempts && !better; ++attempt) {
      Eigen::MatrixXd damped = best.normal;
      for (Eigen::Index i = 0; i < n; ++i) damped(i, i) += damping * best.normal(i, i) + floor;
      const Eigen::VectorXd step = dense::solve_symmetric(damped, right);
      if (!step.allFinite()) break;
      std::vector<double> values = best.values;
      for (std::size_t k = 0; k < values.size(); ++k)
        values[k] = std::clamp(values[k] + step(static_cast<Eigen::Index>(k)), parameters[k].low,
                               parameters[k].high);
      Eigen::VectorXd residual = residual_of(values);
      if (residual.squaredNorm() < before) {
        best.values = std::move(values);
        best.residual = std::move(residual);
        damping = std::max(1e-7, damping / 5);
        better = true;
      } else {
        damping *= 6;
      }
    }
    if (!better || before - best.residual.squaredNorm() < settled * before) break;
  }
  return best;
}

}  // namespace servosense::reconcile
