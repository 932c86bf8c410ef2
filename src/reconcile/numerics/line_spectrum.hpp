// A line that stands out of the spectrum of a record with gaps.
#pragma once

#include <Eigen/Dense>
#include <functional>
#include <optional>

#include "servosense/reconcile/criteria.hpp"

namespace servosense::reconcile {

/// Size of a transform over `length` samples: twice as long, so that a line between two bins is not
/// lost.
[[nodiscard]] Eigen::Index transform_size(Eigen::Index length, Eigen::Index least);
/// Squares of the lines of `signal`, from zero to half its rate.
[[nodiscard]] Eigen::VectorXd power_of(const Eigen::VectorXd& signal);
/// Power that a share of the lines, the mean apart, does not exceed.
[[nodiscard]] double quantile_of(const Eigen::VectorXd& power, double share);
/// The strongest line of those that count, if noise does not do that and it is no skirt of another.
[[nodiscard]] std::optional<Eigen::Index> peak_of(const Eigen::VectorXd& power,
                                                  const std::function<bool(Eigen::Index)>& counts,
                                                  const Criteria& criteria);

}  // namespace servosense::reconcile
