#include "idle_regression.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "dsp/dense.hpp"

namespace servosense::idle_fit {
namespace {

Eigen::Map<const Eigen::VectorXd> mapped(const Column& column) {
  return {column.data(), static_cast<Eigen::Index>(column.size())};
}

/// Half width of a 95 % interval in standard errors known to `freedom` degrees, over that of the
/// normal distribution (Student 1908).
double student(std::size_t freedom) {
  constexpr std::array<double, 10> quantile = {12.71, 4.303, 3.182, 2.776, 2.571,
                                               2.447, 2.365, 2.306, 2.262, 2.228};
  return quantile[std::clamp<std::size_t>(freedom, 1, quantile.size()) - 1] / 1.96;
}

/// Sum over lags of the products of rows, weighed down to nothing at `length` (Bartlett): the
/// products of sums over windows of that length, of which it is the same by hand.
Eigen::MatrixXd over_windows(const Eigen::MatrixXd& rows, Eigen::Index length) {
  const Eigen::Index n = rows.rows();
  Eigen::MatrixXd sums(n + length - 1, rows.cols());
  for (Eigen::Index j = 0; j < rows.cols(); ++j) {
    double sum = 0;
    for (Eigen::Index i = 0; i < sums.rows(); ++i) {
      if (i < n) sum += rows(i, j);
      if (i >= length) sum -= rows(i - length, j);
      sums(i, j) = sum;
    }
  }
  return sums.transpose() * sums / static_cast<double>(length);
}

/// x' C x, with the covariance of two rows by their lag; beyond the last there is none.
Eigen::MatrixXd between(const Eigen::MatrixXd& x, const Eigen::VectorXd& covariance) {
  constexpr Eigen::Index kChunk = 1024;  // stays in the cache
  const Eigen::Index n = x.rows();
  Eigen::MatrixXd later = Eigen::MatrixXd::Zero(n, x.cols());
  for (Eigen::Index j = 0; j < x.cols(); ++j)
    for (Eigen::Index from = 0; from < n; from += kChunk) {
      const Eigen::Index end = std::min(from + kChunk, n);
      for (Eigen::Index l = 1; l < covariance.size() && l < end; ++l) {
        const Eigen::Index first = std::max(from, l);
        later.col(j).segment(first, end - first) +=
            covariance(l) * x.col(j).segment(first - l, end - first);
      }
    }
  const Eigen::MatrixXd one_way = x.transpose() * later;
  return covariance(0) * (x.transpose() * x) + one_way + one_way.transpose();
}

}  // namespace

Regression regress(const Columns& columns, const Column& output, std::size_t lag) {
  const auto n = static_cast<Eigen::Index>(output.size());
  const auto k = static_cast<Eigen::Index>(columns.size());
  Eigen::MatrixXd x(n, k);
  for (Eigen::Index j = 0; j < k; ++j) x.col(j) = mapped(*columns[static_cast<std::size_t>(j)]);
  const auto y = mapped(output);
  Regression r;
  const Eigen::MatrixXd inverse = dense::inverse_symmetric(x.transpose() * x);
  r.parameters = dense::least_squares(x, Eigen::VectorXd(y));
  const Eigen::VectorXd e = y - x * r.parameters;
  const Eigen::MatrixXd score = x.array().colwise() * e.array();
  const auto longest = std::min<Eigen::Index>(static_cast<Eigen::Index>(lag), n - 1);
  const Eigen::MatrixXd local = over_windows(score, longest + 1);
  Eigen::VectorXd covariance(longest + 1);
  for (Eigen::Index l = 0; l <= longest; ++l)
    covariance(l) = (1 - static_cast<double>(l) / static_cast<double>(longest + 1)) *
                    e.tail(n - l).dot(e.head(n - l)) / static_cast<double>(n);
  const Eigen::MatrixXd pooled = between(x, covariance);
  const double freedom =
      static_cast<double>(n) / static_cast<double>(std::max<Eigen::Index>(n - k, 1));
  const auto variances = [&](const Eigen::MatrixXd& middle) -> Eigen::VectorXd {
    return freedom * (inverse * middle * inverse).diagonal();
  };
  r.standard_errors = variances(local).cwiseMax(variances(pooled)).cwiseMax(0).cwiseSqrt();
  r.residual_rms = std::sqrt(e.squaredNorm() / static_cast<double>(n));
  r.output_rms = std::sqrt(y.squaredNorm() / static_cast<double>(n));
  r.output_spread = std::sqrt((y.array() - y.mean()).square().mean());
  return r;
}

double condition(const Columns& columns) {
  const auto k = static_cast<Eigen::Index>(columns.size());
  Eigen::MatrixXd gram(k, k);
  for (Eigen::Index i = 0; i < k; ++i)
    for (Eigen::Index j = 0; j < k; ++j)
      gram(i, j) = mapped(*columns[static_cast<std::size_t>(i)])
                       .dot(mapped(*columns[static_cast<std::size_t>(j)]));
  const Eigen::VectorXd scale = gram.diagonal().cwiseSqrt();
  for (Eigen::Index i = 0; i < k; ++i)
    for (Eigen::Index j = 0; j < k; ++j) gram(i, j) /= std::max(scale(i) * scale(j), 1e-300);
  const Eigen::VectorXd eigen = dense::symmetric_eigen(gram).values;
  return std::sqrt(eigen.maxCoeff() / std::max(eigen.minCoeff(), 1e-300));
}

Eigen::VectorXd moved_by(const Regression& fit, const Regression& other) {
  const Eigen::Index k = fit.parameters.size();
  const Eigen::ArrayXd moved = (other.parameters.head(k) - fit.parameters).array();
  const Eigen::ArrayXd noise =
      (other.standard_errors.head(k).array().square() - fit.standard_errors.array().square())
          .max(0);
  return (moved.square() - noise).max(0).matrix();
}

Eigen::VectorXd moved_by_speeds(const Regression& fit, const Columns& columns, const Column& output,
                                const Column& speed) {
  constexpr std::size_t kGroups = 8;    // down to a hundredth of the highest speed
  constexpr double kLeastShare = 0.01;  // of the rows: fewer make no group of their own
  const auto k = static_cast<Eigen::Index>(columns.size());
  double highest = 0;
  for (const double v : speed) highest = std::max(highest, std::abs(v));
  std::array<Eigen::MatrixXd, kGroups> gram;
  std::array<Eigen::VectorXd, kGroups> moment;
  std::array<std::size_t, kGroups> rows{};
  gram.fill(Eigen::MatrixXd::Zero(k, k));
  moment.fill(Eigen::VectorXd::Zero(k));
  Eigen::VectorXd row(k);
  for (std::size_t i = 0; i < output.size(); ++i) {
    for (Eigen::Index j = 0; j < k; ++j) row(j) = (*columns[static_cast<std::size_t>(j)])[i];
    const double below = std::log2(highest / std::max(std::abs(speed[i]), 1e-12 * highest));
    const auto g =
        static_cast<std::size_t>(std::clamp(std::floor(below + 0.5), 0.0, kGroups - 1.0));
    gram[g] += row * row.transpose();
    moment[g] += row * output[i];
    ++rows[g];
  }
  Eigen::MatrixXd whole = Eigen::MatrixXd::Zero(k, k);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(k);
  for (std::size_t g = 0; g < kGroups; ++g) {
    whole += gram[g];
    right += moment[g];
  }
  // A group that much hangs on moves the fit by noise alone: that is taken off (Hausman 1978).
  const Eigen::ArrayXd spread = dense::pseudo_inverse(whole).diagonal().array();
  const Eigen::ArrayXd noise = fit.standard_errors.array().square();
  Eigen::ArrayXd squares = Eigen::ArrayXd::Zero(k);
  std::size_t groups = 0;
  for (std::size_t g = 0; g < kGroups; ++g) {
    if (static_cast<double>(rows[g]) < kLeastShare * static_cast<double>(output.size())) continue;
    const Eigen::MatrixXd without = dense::pseudo_inverse(whole - gram[g]);
    const Eigen::ArrayXd moved = (without * (right - moment[g]) - fit.parameters).array();
    squares += (moved.square() - noise * (without.diagonal().array() / spread - 1)).max(0);
    ++groups;
  }
  if (groups < 2) return Eigen::VectorXd::Zero(k);
  const double wide = student(groups > 2 ? groups - 2 : 1);
  return (wide * wide * static_cast<double>(groups - 1) / static_cast<double>(groups) * squares)
      .matrix();
}

}  // namespace servosense::idle_fit
