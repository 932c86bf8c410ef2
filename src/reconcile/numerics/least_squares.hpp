// Least squares by blocks: second moments are kept for each block of rows, so leaving blocks out,
// resampling them and comparing losses block by block cost nothing beyond small matrices.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "servosense/reconcile/problem.hpp"

namespace servosense::reconcile {

/// Rows of a problem that are fitted, and the block of each.
struct FitRows {
  std::vector<std::size_t> rows;
  std::vector<std::size_t> first;  ///< of each block, in `rows`; one more than blocks
  [[nodiscard]] std::size_t blocks() const { return first.size() - 1; }
};
/// Rows in so many blocks of equal size.
FitRows in_blocks(std::vector<std::size_t> rows, std::size_t blocks);
/// Usable rows that are not held out (or, `held_out`, those that are), in blocks of equal size.
FitRows fit_rows(const Problem& problem, std::size_t blocks, bool held_out = false);

struct Fit {
  Eigen::VectorXd coefficients;
  Eigen::VectorXd standard_errors;  ///< from leaving out blocks (jackknife)
  double mean_square = 0;           ///< of the rows fitted
  double loss = 0;                  ///< mean square of rows left out of the fit
  std::vector<double> block_loss;   ///< sum of squares, left out
  /// From that of a column on.
  [[nodiscard]] std::span<const double> coefficients_from(Eigen::Index column) const {
    return {coefficients.data() + column, coefficients.data() + coefficients.size()};
  }
};

/// Columns and target over the fitted rows, with their moments.
class Regression {
 public:
  Regression(const FitRows& rows, const Column& target);
  void add(const Column& column);
  [[nodiscard]] Eigen::Index columns() const { return matrix_.cols(); }

  /// All columns and the target.
  [[nodiscard]] Fit fit() const { return fit_with({}); }
  /// The same with further columns.
  [[nodiscard]] Fit fit_with(const std::vector<Column>& extra) const;
  /// What the columns leave of the target, over the fitted rows.
  [[nodiscard]] const Eigen::VectorXd& rest() const {
    prepare();
    return rest_;
  }
  /// The same columns for another target.
  [[nodiscard]] Regression with_target(const Column& target) const;
  /// Norm of a column that the columns cannot imitate, over its own.
  [[nodiscard]] double share_left(const Column& extra) const;
  /// A column without what the columns can imitate, over the fitted rows.
  [[nodiscard]] Eigen::VectorXd projected(const Column& extra) const;
  [[nodiscard]] Eigen::VectorXd picked(const Column& column) const;

 private:
  void prepare() const;

  const FitRows* rows_;
  Eigen::VectorXd target_;
  Eigen::MatrixXd matrix_;
  mutable bool ready_ = false;
  mutable Eigen::Index in_basis_ = 0;  // columns
  mutable Eigen::MatrixXd basis_;      // orthonormal
  mutable Eigen::VectorXd rest_;       // of the target
};

/// Mean square of what is left of a target.
[[nodiscard]] double mean_square_of(const Eigen::VectorXd& rest);

/// What further columns have beyond those of a regression, to be fitted to any number of targets;
/// the fast half of fit_with().
class Addition {
 public:
  /// `sized`: their coefficients are 1.
  Addition(const Regression& known, const std::vector<Column>& extra, bool sized);
  /// What is left where the regression leaves `rest`.
  [[nodiscard]] Eigen::VectorXd left_of(const Eigen::VectorXd& rest) const;
  [[nodiscard]] double mean_square(const Eigen::VectorXd& rest) const {
    return mean_square_of(left_of(rest));
  }

 private:
  bool sized_;
  Eigen::MatrixXd columns_;  // orthonormal unless sized
};

/// Square root of what noise may have made negative.
[[nodiscard]] inline double root(double square) { return std::sqrt(std::max(0.0, square)); }

/// The known terms of a problem over some of its rows.
[[nodiscard]] Regression regression_of_known(const Problem& problem, const FitRows& rows);

/// Rms over some rows; 0 over none.
[[nodiscard]] double rms_over(const Column& column, std::span<const std::size_t> rows);

/// Sum of coefficients * columns over all rows. The coefficients may be more: the first ones count.
[[nodiscard]] Column weighted_sum(const std::vector<Column>& columns,
                                  std::span<const double> coefficients);

/// target - sum of coefficients * columns over all rows.
Column residual_of(const Column& target, const std::vector<const Column*>& columns,
                   const Eigen::VectorXd& coefficients);

}  // namespace servosense::reconcile
