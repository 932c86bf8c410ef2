#include "analysis.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace blind {
namespace {

void butterworth(Signal& x, double rate_hz, double cutoff_hz) {
  const double w = std::tan(std::numbers::pi * cutoff_hz / rate_hz);
  const double norm = 1 / (1 + std::numbers::sqrt2 * w + w * w);
  const double b = w * w * norm;
  const double a1 = 2 * (w * w - 1) * norm;
  const double a2 = (1 - std::numbers::sqrt2 * w + w * w) * norm;
  // At rest on the first value.
  double x1 = x.front(), x2 = x1, y1 = x1, y2 = x1;
  for (double& value : x) {
    const double y = b * (value + 2 * x1 + x2) - a1 * y1 - a2 * y2;
    x2 = x1, x1 = value, y2 = y1, y1 = y;
    value = y;
  }
}

}  // namespace

Signal low_pass(const Signal& signal, double rate_hz, double cutoff_hz) {
  if (signal.empty()) return {};
  const double start = signal.front();
  Signal x = signal;
  for (double& value : x) value -= start;  // large positions cost no digits
  butterworth(x, rate_hz, cutoff_hz);
  std::ranges::reverse(x);
  butterworth(x, rate_hz, cutoff_hz);
  std::ranges::reverse(x);
  for (double& value : x) value += start;
  return x;
}

Signal derivative(const Signal& x, double rate_hz) {
  Signal d(x.size(), 0.0);
  for (std::size_t i = 2; i + 2 < x.size(); ++i)
    d[i] = (8 * (x[i + 1] - x[i - 1]) - (x[i + 2] - x[i - 2])) * rate_hz / 12;
  return d;
}

Signal soft_sign(const Signal& position, double knee) {
  Signal s(position.size(), 0.0);
  for (std::size_t i = 1; i < s.size(); ++i)
    s[i] = std::clamp(s[i - 1] + (position[i] - position[i - 1]) / knee, -1.0, 1.0);
  return s;
}

Signal fading_sign(const Signal& position, double knee) {
  Signal s(position.size(), 0.0);
  for (std::size_t i = 1; i < s.size(); ++i) {
    const double step = position[i] - position[i - 1];
    const double keep = std::exp(-std::abs(step) / knee);
    s[i] = s[i - 1] * keep + (step > 0 ? 1 - keep : keep - 1);
  }
  return s;
}

Fit least_squares(const std::vector<Signal>& columns, const Signal& target, std::size_t from,
                  std::size_t to) {
  const auto n = static_cast<Eigen::Index>(columns.size());
  Eigen::VectorXd scale = Eigen::VectorXd::Ones(n);
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  const auto column = [&](Eigen::Index i) -> const Signal& {
    return columns[static_cast<std::size_t>(i)];
  };
  for (Eigen::Index i = 0; i < n; ++i) scale[i] = std::max(rms(column(i), from, to), 1e-300);
  for (std::size_t k = from; k < to; ++k)
    for (Eigen::Index i = 0; i < n; ++i) {
      const double c = column(i)[k] / scale[i];
      right[i] += c * target[k];
      for (Eigen::Index j = 0; j <= i; ++j) normal(i, j) += c * column(j)[k] / scale[j];
    }
  const Eigen::MatrixXd full = normal.selfadjointView<Eigen::Lower>();
  const Eigen::VectorXd solution =
      full.completeOrthogonalDecomposition().solve(right).cwiseQuotient(scale);
  Fit fit;
  fit.coefficients.assign(solution.begin(), solution.end());
  fit.residual = target;
  for (Eigen::Index i = 0; i < n; ++i)
    for (std::size_t k = 0; k < target.size(); ++k) fit.residual[k] -= solution[i] * column(i)[k];
  return fit;
}

double rms(const Signal& x, std::size_t from, std::size_t to) {
  double sum = 0;
  for (std::size_t i = from; i < to; ++i) sum += x[i] * x[i];
  return to > from ? std::sqrt(sum / static_cast<double>(to - from)) : 0;
}

}  // namespace blind
