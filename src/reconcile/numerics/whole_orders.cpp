#include "reconcile/numerics/whole_orders.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "dsp/dense.hpp"

namespace servosense::reconcile {

WholeOrders::WholeOrders(const Eigen::MatrixXd& gram, Eigen::VectorXd right, int others)
    : gram_(gram),
      right_(std::move(right)),
      others_(others),
      highest_((static_cast<int>(gram.rows()) - others) / 2),
      columns_(static_cast<std::size_t>(others)) {
  std::iota(columns_.begin(), columns_.end(), 0);
  explained_ = explained_by(columns_);
}

std::vector<int> WholeOrders::with(int order) const {
  std::vector<int> columns = columns_;
  columns.push_back(others_ + 2 * (order - 1));
  columns.push_back(columns.back() + 1);
  return columns;
}

double WholeOrders::explained_by(const std::vector<int>& columns) const {
  const Eigen::MatrixXd g = gram_(columns, columns);
  const Eigen::VectorXd r = right_(columns);
  return r.dot(dense::solve_symmetric(g, r));
}

WholeOrders::Next WholeOrders::next() const {
  Next best;
  for (int order = 1; order <= highest_; ++order) {
    const std::vector<int> columns = with(order);
    if (std::ranges::find(columns_, columns.back()) != columns_.end()) continue;
    const double more = explained_by(columns) - explained_;
    if (more > best.more)
      best = {order, more, best.more};
    else
      best.second = std::max(best.second, more);
  }
  return best;
}

void WholeOrders::add(int order) {
  columns_ = with(order);
  explained_ = explained_by(columns_);
}

}  // namespace servosense::reconcile
