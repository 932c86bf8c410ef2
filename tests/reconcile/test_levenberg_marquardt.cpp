// Nonlinear least squares: against certified values, at a bound, and with nothing to fit.
#include <cmath>
#include <limits>

#include "check.hpp"
#include "reconcile/numerics/levenberg_marquardt.hpp"

using namespace servosense::reconcile;

namespace {

// NIST Statistical Reference Datasets, Misra1a (Misra 1978): dental monolayers, 14 points.
constexpr double kX[] = {77.6,  114.9, 141.1, 190.8, 239.9, 289.0, 332.8,
                         378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0};
constexpr double kY[] = {10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02,
                         44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78};
constexpr int kPoints = 14;

/// y - b1 (1 - exp(-b2 x)), parameters as logarithms.
Eigen::VectorXd misra(const std::vector<double>& v) {
  Eigen::VectorXd left(kPoints);
  for (int i = 0; i < kPoints; ++i)
    left(i) = kY[i] - std::exp(v[0]) * (1 - std::exp(-std::exp(v[1]) * kX[i]));
  return left;
}

const std::vector<BoundedParameter> kWide = {{0, 10, 1e-6}, {-20, 0, 1e-6}};

void certified() {
  // The first of NIST's two starts, the harder one.
  const NonlinearFit fit =
      levenberg_marquardt(misra, {std::log(500.0), std::log(1e-4)}, kWide, 100, 1e-14);
  CHECK_NEAR(std::exp(fit.values[0]) / 2.3894212918e+02, 1, 1e-6);
  CHECK_NEAR(std::exp(fit.values[1]) / 5.5015643181e-04, 1, 1e-6);
  CHECK_NEAR(fit.residual.squaredNorm() / 1.2455138894e-01, 1, 1e-8);
  // Certified standard deviation of b1, from the slopes and 12 degrees of freedom.
  const double variance = fit.residual.squaredNorm() / (kPoints - 2);
  const double error = std::sqrt(variance * fit.normal.inverse()(0, 0)) * std::exp(fit.values[0]);
  CHECK_NEAR(error / 2.7070075241, 1, 1e-3);
}

/// Held at 200, b1 leaves b2 to a search along a line.
void at_a_bound() {
  const double most = std::log(200.0);
  const NonlinearFit fit = levenberg_marquardt(misra, {std::log(150.0), std::log(1e-4)},
                                               {{0, most, 1e-6}, {-20, 0, 1e-6}}, 200, 1e-14);
  CHECK_NEAR(fit.values[0], most, 0);
  double least = std::numeric_limits<double>::infinity(), at = 0;
  for (int i = 0; i < 20000; ++i) {
    const double v = std::log(5e-4) + i * 2e-5;
    const double square = misra({most, v}).squaredNorm();
    if (square < least) {
      least = square;
      at = v;
    }
  }
  CHECK_NEAR(fit.values[1], at, 3e-5);
}

void nothing_to_do() {
  const NonlinearFit none = levenberg_marquardt(misra, {5.4, -7.5}, {}, 10, 1e-6);
  CHECK_NEAR(none.values[0], 5.4, 0);
  const auto lost = [](const std::vector<double>&) {
    return Eigen::VectorXd(Eigen::VectorXd::Constant(3, std::nan("")));
  };
  CHECK_NEAR(levenberg_marquardt(lost, {1, 2}, kWide, 10, 1e-6).values[1], 2, 0);
}

}  // namespace

int main() {
  certified();
  at_a_bound();
  nothing_to_do();
  return check::done();
}
