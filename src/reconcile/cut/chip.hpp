// Chips of the teeth over the arc of engagement, on trochoids or circles (force_model.hpp).
#pragma once

#include <Eigen/Dense>
#include <cstddef>
#include <span>
#include <vector>

#include "reconcile/cut/force_model.hpp"

namespace servosense::reconcile {

[[nodiscard]] double pitch_angle(const MillingTool& tool, std::size_t tooth);
/// Of the helix, from the tip to the top of the cut.
[[nodiscard]] double total_lag(const CutState& state);

/// Part of the depth, from `low` to `high`, in which the same teeth still have their edge.
struct Zone {
  double low = 0, high = 0;  // of the depth
  std::vector<std::size_t> teeth;
};
[[nodiscard]] std::vector<Zone> zones_of(const MillingTool& tool);

/// Angles over the arc of engagement, between which all is taken as linear.
struct ArcPoints {
  static constexpr Eigen::Index kSteps = 360;
  explicit ArcPoints(const Engagement& arc);
  double start_rad, step_rad;
  Eigen::ArrayXd sine, cosine;
};

/// Room between a tooth and what the others of its zone have left, at each point of the arc;
/// negative where an earlier tooth has left nothing.
[[nodiscard]] Eigen::ArrayXd room_m(const CutState& state, const Zone& zone, std::size_t tooth,
                                    double feed_per_tooth_m, const ArcPoints& arc);

/// Forces per unit coefficient of a rigid tool, on the tool.
[[nodiscard]] Eigen::MatrixXd rigid_columns(const CutState& state, double feed_per_tooth_m,
                                            std::span<const double> angles_rad);

}  // namespace servosense::reconcile
