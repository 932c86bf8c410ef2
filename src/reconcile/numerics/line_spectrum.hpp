// A line that stands out of the spectrum of a record with gaps.
#pragma once

#include <Eigen/Dense>
#include <functional>
#include <optional>

namespace servosense::reconcile {

/// Periods that a line must have in the record: what has fewer is a drift.
inline constexpr double kLeastPeriods = 8;
/// Resolutions between a line and what turns with the tool, whose mean is taken off.
inline constexpr double kApart = 1.5;
/// Share of a line's power that must be there in the part kept for the proof.
inline constexpr double kLeastHeld = 0.5;

/// Size of a transform over `length` samples: twice as long, so that a line between two bins is not
/// lost.
[[nodiscard]] Eigen::Index transform_size(Eigen::Index length, Eigen::Index least);
/// Squares of the lines of `signal`, from zero to half its rate.
[[nodiscard]] Eigen::VectorXd power_of(const Eigen::VectorXd& signal);
/// Power that a share of the lines, the mean apart, does not exceed.
[[nodiscard]] double quantile_of(const Eigen::VectorXd& power, double share);
/// The strongest line of those that count, if noise does not do that and it is no skirt of another.
[[nodiscard]] std::optional<Eigen::Index> peak_of(const Eigen::VectorXd& power,
                                                  const std::function<bool(Eigen::Index)>& counts);

}  // namespace servosense::reconcile
