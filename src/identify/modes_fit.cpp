#include "modes_fit.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dsp/dense.hpp"

namespace servosense::modes {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;
using Eigen::VectorXd;

constexpr int kPasses = 60;
constexpr double kConverged = 1e-8;  // of the sum of squares, and far below any standard error

/// Real and imaginary parts below one another, each line over its noise.
template <typename Columns>
MatrixXd stacked(const Columns& columns, const VectorXd& noise) {
  const MatrixXcd weighted = noise.cwiseInverse().asDiagonal() * columns;
  MatrixXd all(2 * weighted.rows(), weighted.cols());
  all << weighted.real(), weighted.imag();
  return all;
}

Complex term_of(const Pole& pole, Complex s) {
  return 1.0 / (s * s + 2 * pole.damping * pole.w_rad_s * s + pole.w_rad_s * pole.w_rad_s);
}

MatrixXcd linear_columns(const Lines& lines, const std::vector<Pole>& poles) {
  const auto n = static_cast<Index>(poles.size());
  MatrixXcd columns(lines.count(), n + 2);
  for (Index k = 0; k < lines.count(); ++k) {
    const Complex s = lines.s(k);
    for (Index r = 0; r < n; ++r) columns(k, r) = term_of(poles[static_cast<std::size_t>(r)], s);
    columns(k, n) = 1;
    columns(k, n + 1) = 1.0 / (s * s);
  }
  return columns;
}

/// Derivatives of the response by log w and log damping of each pole.
MatrixXcd pole_columns(const Lines& lines, const std::vector<Pole>& poles, const VectorXd& values) {
  const auto n = static_cast<Index>(poles.size());
  MatrixXcd columns(lines.count(), 2 * n);
  for (Index k = 0; k < lines.count(); ++k) {
    const Complex s = lines.s(k);
    for (Index r = 0; r < n; ++r) {
      const Pole& pole = poles[static_cast<std::size_t>(r)];
      const Complex term = term_of(pole, s);
      const Complex damped = 2 * pole.damping * pole.w_rad_s * s;
      const Complex squared = -values(r) * term * term;
      columns(k, 2 * r) = squared * (damped + 2 * pole.w_rad_s * pole.w_rad_s);
      columns(k, 2 * r + 1) = squared * damped;
    }
  }
  return columns;
}

/// The linear problem of one receptance, columns scaled to length 1.
struct Projection {
  MatrixXd q;        // orthonormal
  MatrixXd inverse;  // values = inverse * q^T y
  VectorXd values;
  VectorXd rest;

  Projection(const Lines& lines, const std::vector<Pole>& poles) {
    MatrixXd columns = stacked(linear_columns(lines, poles), lines.noise);
    const VectorXd length = columns.colwise().norm();
    columns *= length.cwiseInverse().asDiagonal();
    const Index n = columns.cols();
    dense::ThinQr qr = dense::thin_qr(columns);
    q = std::move(qr.q);
    inverse = qr.r.triangularView<Eigen::Upper>().solve(MatrixXd::Identity(n, n));
    inverse = length.cwiseInverse().asDiagonal() * inverse;
    const VectorXd y = stacked(lines.response, lines.noise);
    const VectorXd along = q.transpose() * y;
    values = inverse * along;
    rest = y - q * along;
  }
};

/// Level of the rest, and how alike it is from line to line: 1 + 2 sum of its correlations, up to
/// the first that chance explains.
void judge_rest(LinearFit& fit, double unknowns) {
  const Index n = fit.rest.size();
  const double square = fit.rest.squaredNorm();
  fit.level = square / std::max(1.0, 2.0 * static_cast<double>(n) - unknowns);
  if (!(square > 0)) return;
  const double chance = 2 / std::sqrt(2.0 * static_cast<double>(n));
  for (Index lag = 1; lag < n / 4; ++lag) {
    const double alike = fit.rest.head(n - lag).dot(fit.rest.tail(n - lag)).real() / square;
    if (!(alike > chance)) break;
    fit.alike += 2 * alike;
  }
}

LinearFit linear_fit(const Projection& p, double unknowns) {
  LinearFit fit;
  fit.values = p.values;
  const Index n = p.rest.size() / 2;
  fit.rest = p.rest.head(n) + Complex(0, 1) * p.rest.tail(n);
  judge_rest(fit, unknowns);
  fit.covariance = fit.scale() * p.inverse * p.inverse.transpose();
  return fit;
}

double unknowns_of(const std::vector<Lines>& lines, const std::vector<Pole>& poles) {
  const auto n = static_cast<double>(poles.size());
  return n + 2 + 2 * n / static_cast<double>(lines.size());
}

struct Step {
  double square = 0;  // sum, before the step
  MatrixXd hessian;   // what is linear eliminated
  VectorXd gradient;
};

Step step_of(const std::vector<Lines>& lines, const std::vector<Pole>& poles) {
  const auto n = static_cast<Index>(2 * poles.size());
  Step step{0, MatrixXd::Zero(n, n), VectorXd::Zero(n)};
  for (const Lines& l : lines) {
    const Projection p(l, poles);
    MatrixXd j = stacked(pole_columns(l, poles, p.values), l.noise);
    j -= p.q * (p.q.transpose() * j);
    step.square += p.rest.squaredNorm();
    step.hessian.noalias() += j.transpose() * j;
    step.gradient.noalias() += j.transpose() * p.rest;
  }
  return step;
}

double square_of(const std::vector<Lines>& lines, const std::vector<Pole>& poles) {
  double square = 0;
  for (const Lines& l : lines) square += Projection(l, poles).rest.squaredNorm();
  return square;
}

std::vector<Pole> moved(const std::vector<Pole>& poles, const VectorXd& by) {
  std::vector<Pole> result = poles;
  for (std::size_t r = 0; r < poles.size(); ++r) {
    const auto at = static_cast<Index>(2 * r);
    result[r].w_rad_s *= std::exp(std::clamp(by(at), -0.1, 0.1));
    result[r].damping =
        std::min(0.99, result[r].damping * std::exp(std::clamp(by(at + 1), -1., 1.)));
  }
  return result;
}

}  // namespace

PoleFit fit_linear(const std::vector<Lines>& lines, std::vector<Pole> poles) {
  PoleFit fit{std::move(poles), {}, {}};
  for (const Lines& l : lines)
    fit.receptances.push_back(linear_fit({l, fit.poles}, unknowns_of(lines, fit.poles)));
  return fit;
}

PoleFit refine(const std::vector<Lines>& lines, std::vector<Pole> poles) {
  double damping = 1e-3;
  for (int pass = 0; pass < kPasses && !poles.empty(); ++pass) {
    const Step step = step_of(lines, poles);
    bool better = false, still = false;
    while (damping < 1e10) {
      MatrixXd hessian = step.hessian;
      hessian.diagonal() *= 1 + damping;
      const std::vector<Pole> next = moved(poles, dense::solve_symmetric(hessian, step.gradient));
      const double square = square_of(lines, next);
      better = square < step.square;
      if (better) {
        still = step.square - square < kConverged * step.square;
        poles = next;
        damping *= 0.1;
        break;
      }
      damping *= 10;
    }
    if (!better || still) break;
  }
  PoleFit fit = fit_linear(lines, std::move(poles));
  if (fit.poles.empty()) return fit;
  const auto n = static_cast<Index>(2 * fit.poles.size());
  MatrixXd hessian = MatrixXd::Zero(n, n), spread = hessian;
  std::vector<MatrixXd> follow;  // of the linear values by the poles
  std::vector<MatrixXd> inverse;
  for (std::size_t f = 0; f < lines.size(); ++f) {
    const Projection p(lines[f], fit.poles);
    MatrixXd j = stacked(pole_columns(lines[f], fit.poles, p.values), lines[f].noise);
    const MatrixXd along = p.q.transpose() * j;
    follow.push_back(p.inverse * along);
    j -= p.q * along;
    const MatrixXd information = j.transpose() * j;
    hessian += information;
    spread += fit.receptances[f].scale() * information;
  }
  const MatrixXd inverse_hessian = dense::pseudo_inverse(hessian);
  fit.covariance = inverse_hessian * spread * inverse_hessian;
  for (std::size_t f = 0; f < lines.size(); ++f)
    fit.receptances[f].covariance += follow[f] * fit.covariance * follow[f].transpose();
  return fit;
}

double need_of(const PoleFit& fit, std::size_t pole) {
  const auto at = static_cast<Index>(pole);
  double need = 0;
  for (const LinearFit& f : fit.receptances)
    need += f.values(at) * f.values(at) / f.covariance(at, at) *
            (fit.covariance.size() > 0 ? 1 : f.alike);
  return need;
}

double gain_of(const std::vector<Lines>& lines, const PoleFit& fit, const Pole& pole) {
  double gain = 0;
  for (std::size_t f = 0; f < lines.size(); ++f) {
    const Projection known(lines[f], fit.poles);
    VectorXd column = stacked(linear_columns(lines[f], {pole}).leftCols(1), lines[f].noise);
    column -= known.q * (known.q.transpose() * column);
    const double along = column.dot(known.rest);
    gain += along * along / column.squaredNorm() / fit.receptances[f].scale();
  }
  return gain;
}

VectorXcd fitted_response(const Lines& lines, const PoleFit& fit, std::size_t receptance) {
  return linear_columns(lines, fit.poles) * fit.receptances[receptance].values;
}

}  // namespace servosense::modes
