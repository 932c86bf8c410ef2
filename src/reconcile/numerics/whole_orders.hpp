// Whole orders of a turn that explain most of a signal, one after the other.
#pragma once

#include <Eigen/Dense>
#include <vector>

namespace servosense::reconcile {

/// Sines and cosines of orders 1, 2... beside other columns, by their moments. Unlike a spectrum
/// this is exact where most of the samples creep through parts of a turn, in which all orders look
/// alike.
class WholeOrders {
 public:
  /// Moments of the columns with each other and with the signal: `others` columns that are always
  /// there, then sine and cosine of each order.
  WholeOrders(const Eigen::MatrixXd& gram, Eigen::VectorXd right, int others);

  struct Next {
    int order = 0;                ///< 0: none is left that explains anything
    double more = 0, second = 0;  ///< sum of squares that it explains, and the next best order
  };
  /// The order that explains most beside those added.
  [[nodiscard]] Next next() const;
  void add(int order);
  /// Sum of squares that is explained so far.
  [[nodiscard]] double explained() const { return explained_; }

 private:
  [[nodiscard]] std::vector<int> with(int order) const;
  [[nodiscard]] double explained_by(const std::vector<int>& columns) const;

  const Eigen::MatrixXd& gram_;
  Eigen::VectorXd right_;
  int others_, highest_;
  std::vector<int> columns_;
  double explained_;
};

}  // namespace servosense::reconcile
