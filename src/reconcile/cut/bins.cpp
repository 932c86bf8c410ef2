#include "reconcile/cut/bins.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "servosense/core/units.hpp"

namespace servosense::reconcile {

BinnedAngles::BinnedAngles(std::vector<double> angles_rad, std::size_t bins)
    : angle_rad_(std::move(angles_rad)), sum_before_(1, 0) {
  std::sort(angle_rad_.begin(), angle_rad_.end());
  sum_before_.reserve(angle_rad_.size() + 1);
  for (const double a : angle_rad_) sum_before_.push_back(sum_before_.back() + a);
  const double width = kTwoPi / static_cast<double>(bins);
  for (std::size_t b = 0; b <= bins; ++b)
    begin_.push_back(
        b == bins ? angle_rad_.size()
                  : static_cast<std::size_t>(std::lower_bound(angle_rad_.begin(), angle_rad_.end(),
                                                              static_cast<double>(b) * width) -
                                             angle_rad_.begin()));
  for (std::size_t b = 0; b < bins; ++b) {
    const std::size_t from = begin_[b], to = begin_[b + 1];
    mean_rad_.push_back(to > from
                            ? (sum_before_[to] - sum_before_[from]) / static_cast<double>(to - from)
                            : (static_cast<double>(b) + 0.5) * width);
  }
}

BinnedAngles::Parts BinnedAngles::cut_at(std::vector<double> breaks_rad) const {
  std::vector<std::size_t> cuts;  // first sample after each
  for (double a : breaks_rad) {
    a -= kTwoPi * std::floor(a / kTwoPi);
    cuts.push_back(static_cast<std::size_t>(
        std::lower_bound(angle_rad_.begin(), angle_rad_.end(), a) - angle_rad_.begin()));
  }
  std::sort(cuts.begin(), cuts.end());
  Parts parts;
  auto cut = cuts.begin();
  for (std::size_t b = 0; b < mean_rad_.size(); ++b) {
    const std::size_t end = begin_[b + 1];
    const auto all = static_cast<double>(end - begin_[b]);
    std::size_t from = begin_[b];
    const auto add = [&](double angle, double share) {
      parts.angle_rad.push_back(angle);
      parts.share.push_back(share);
      parts.bin.push_back(static_cast<Eigen::Index>(b));
    };
    while (cut != cuts.end() && *cut <= from) ++cut;
    if (end == from || cut == cuts.end() || *cut >= end) {
      add(mean_rad_[b], 1);
      continue;
    }
    while (from < end) {
      while (cut != cuts.end() && *cut <= from) ++cut;
      const std::size_t to = cut == cuts.end() ? end : std::min(*cut, end);
      const auto count = static_cast<double>(to - from);
      add((sum_before_[to] - sum_before_[from]) / count, count / all);
      from = to;
    }
  }
  return parts;
}

Eigen::MatrixXd BinnedAngles::Parts::over_bins(const Eigen::MatrixXd& columns,
                                               Eigen::Index bins) const {
  const auto n = static_cast<Eigen::Index>(bin.size());
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(2 * bins, columns.cols());
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    out.row(bin[k]) += share[k] * columns.row(i);
    out.row(bins + bin[k]) += share[k] * columns.row(n + i);
  }
  return out;
}

}  // namespace servosense::reconcile
