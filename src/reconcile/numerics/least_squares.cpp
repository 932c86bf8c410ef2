#include "reconcile/numerics/least_squares.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dsp/dense.hpp"
#include "reconcile/numerics/smoother.hpp"

namespace servosense::reconcile {

FitRows in_blocks(std::vector<std::size_t> rows, std::size_t blocks) {
  FitRows fit{std::move(rows), {}};
  for (std::size_t b = 0; b <= blocks; ++b) fit.first.push_back(b * fit.rows.size() / blocks);
  return fit;
}

FitRows fit_rows(const Problem& problem, std::size_t blocks, bool held_out) {
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < problem.rows(); ++i)
    if (problem.usable[i] && problem.held_out[i] == held_out) rows.push_back(i);
  const std::size_t most = std::max<std::size_t>(1, std::min(blocks, rows.size()));
  return in_blocks(std::move(rows), most);
}

Regression::Regression(const FitRows& rows, const Column& target)
    : rows_(&rows), target_(picked(target)), matrix_(target_.size(), 0) {}

Eigen::VectorXd Regression::picked(const Column& column) const {
  Eigen::VectorXd v(static_cast<Eigen::Index>(rows_->rows.size()));
  for (std::size_t i = 0; i < rows_->rows.size(); ++i)
    v(static_cast<Eigen::Index>(i)) = column[rows_->rows[i]];
  return v;
}

void Regression::add(const Column& column) {
  matrix_.conservativeResize(Eigen::NoChange, matrix_.cols() + 1);
  matrix_.col(matrix_.cols() - 1) = picked(column);
  ready_ = false;
}

namespace {

/// Adds to an orthonormal basis what a column has beyond it; nothing when that is rounding.
void extend(Eigen::MatrixXd& basis, Eigen::VectorXd column) {
  const double before = column.norm();
  if (!(before > 0)) return;
  for (int twice = 0; twice < 2 && basis.cols() > 0; ++twice)
    column -= basis * (basis.transpose() * column);
  const double after = column.norm();
  if (!(after > 1e-9 * before)) return;
  basis.conservativeResize(column.size(), basis.cols() + 1);
  basis.col(basis.cols() - 1) = column / after;
}

}  // namespace

void Regression::prepare() const {
  if (ready_) return;
  if (in_basis_ == 0) basis_.resize(target_.size(), 0);
  for (; in_basis_ < matrix_.cols(); ++in_basis_) extend(basis_, matrix_.col(in_basis_));
  rest_ = target_;
  if (basis_.cols() > 0) rest_ -= basis_ * (basis_.transpose() * target_);
  ready_ = true;
}

Eigen::VectorXd Regression::projected(const Column& extra) const {
  prepare();
  Eigen::VectorXd v = picked(extra);
  if (basis_.cols() > 0) v -= basis_ * (basis_.transpose() * v);
  return v;
}

double Regression::share_left(const Column& extra) const {
  const double whole = picked(extra).norm();
  return whole > 0 ? projected(extra).norm() / whole : 0;
}

Regression Regression::with_target(const Column& target) const {
  prepare();
  Regression other = *this;
  other.target_ = picked(target);
  other.ready_ = false;
  return other;
}

double mean_square_of(const Eigen::VectorXd& rest) {
  return rest.squaredNorm() / static_cast<double>(std::max<Eigen::Index>(1, rest.size()));
}

Addition::Addition(const Regression& known, const std::vector<Column>& extra, bool sized)
    : sized_(sized), columns_(known.rest().size(), 0) {
  if (!sized) {
    for (const Column& column : extra) extend(columns_, known.projected(column));
    return;
  }
  columns_.resize(Eigen::NoChange, static_cast<Eigen::Index>(extra.size()));
  for (std::size_t j = 0; j < extra.size(); ++j)
    columns_.col(static_cast<Eigen::Index>(j)) = known.projected(extra[j]);
}

Eigen::VectorXd Addition::left_of(const Eigen::VectorXd& rest) const {
  Eigen::VectorXd left = rest;
  if (sized_)
    for (Eigen::Index j = 0; j < columns_.cols(); ++j) left -= columns_.col(j);
  else if (columns_.cols() > 0)
    left -= columns_ * (columns_.transpose() * left);
  return left;
}

Fit Regression::fit_with(const std::vector<Column>& extra) const {
  const Eigen::Index n = target_.size();
  const Eigen::Index k = matrix_.cols() + static_cast<Eigen::Index>(extra.size());
  Eigen::MatrixXd z(n, k);
  z.leftCols(matrix_.cols()) = matrix_;
  for (std::size_t j = 0; j < extra.size(); ++j)
    z.col(matrix_.cols() + static_cast<Eigen::Index>(j)) = picked(extra[j]);
  Eigen::VectorXd scale(k);
  for (Eigen::Index j = 0; j < k; ++j) {
    scale(j) = std::max(z.col(j).norm(), 1e-300);
    z.col(j) /= scale(j);
  }
  const auto blocks = static_cast<Eigen::Index>(rows_->blocks());
  std::vector<Eigen::MatrixXd> gram;
  std::vector<Eigen::VectorXd> cross;
  std::vector<double> square;
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(k, k);
  Eigen::VectorXd all_cross = Eigen::VectorXd::Zero(k);
  for (Eigen::Index b = 0; b < blocks; ++b) {
    const auto from = static_cast<Eigen::Index>(rows_->first[static_cast<std::size_t>(b)]);
    const auto to = static_cast<Eigen::Index>(rows_->first[static_cast<std::size_t>(b) + 1]);
    const auto part = z.middleRows(from, to - from);
    const auto y = target_.segment(from, to - from);
    gram.emplace_back(part.transpose() * part);
    cross.emplace_back(part.transpose() * y);
    square.push_back(y.squaredNorm());
    all += gram.back();
    all_cross += cross.back();
  }
  // Columns have unit length: the ridge only keeps what cannot be told apart from blowing up.
  const Eigen::MatrixXd ridge = 1e-10 * Eigen::MatrixXd::Identity(k, k);
  Fit fit;
  const Eigen::VectorXd beta = dense::solve_symmetric(all + ridge, all_cross);
  const auto rss = [&](const Eigen::VectorXd& p, std::size_t b) {
    return std::max(0.0, square[b] - 2 * p.dot(cross[b]) + p.dot(gram[b] * p));
  };
  Eigen::VectorXd spread = Eigen::VectorXd::Zero(k);
  double total = 0;
  double left_out = 0;
  for (std::size_t b = 0; b < gram.size(); ++b) {
    total += rss(beta, b);
    const Eigen::VectorXd without =
        dense::solve_symmetric(all - gram[b] + ridge, all_cross - cross[b]);
    spread += (without - beta).cwiseAbs2();
    fit.block_loss.push_back(rss(without, b));
    left_out += fit.block_loss.back();
  }
  const double rows = static_cast<double>(std::max<Eigen::Index>(1, n));
  const auto count = static_cast<double>(gram.size());
  fit.mean_square = total / rows;
  fit.loss = left_out / rows;
  fit.coefficients = beta.cwiseQuotient(scale);
  fit.standard_errors = (spread * ((count - 1) / count)).cwiseSqrt().cwiseQuotient(scale);
  return fit;
}

Regression regression_of_known(const Problem& problem, const FitRows& rows) {
  Regression r(rows, problem.target);
  for (const KnownTerm& term : problem.known) r.add(term.column);
  return r;
}

double rms_over(const Column& column, std::span<const std::size_t> rows) {
  double square = 0;
  for (const std::size_t i : rows) square += column[i] * column[i];
  return std::sqrt(square / static_cast<double>(std::max<std::size_t>(1, rows.size())));
}

Column weighted_sum(const std::vector<Column>& columns, std::span<const double> coefficients) {
  Column sum(columns.empty() ? 0 : columns.front().size(), 0);
  for (std::size_t j = 0; j < columns.size(); ++j) add_to(sum, coefficients[j], columns[j]);
  return sum;
}

Column residual_of(const Column& target, const std::vector<const Column*>& columns,
                   const Eigen::VectorXd& coefficients) {
  Column r = target;
  for (std::size_t j = 0; j < columns.size(); ++j)
    add_to(r, -coefficients(static_cast<Eigen::Index>(j)), *columns[j]);
  return r;
}

}  // namespace servosense::reconcile
