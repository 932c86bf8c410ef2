// What a spindle's power loses on its way to the shaft, told by a current beside it.
//
// The current gives the torque T, so that the power is P = r T w + P0 + k T^2 over means of 50 ms,
// by least squares: r the ratio of the two torques, the rest as in identify/power_losses.hpp. A
// loss within three standard errors of nothing is none.
#pragma once

#include <optional>
#include <vector>

#include "servosense/identify/power_losses.hpp"

namespace servosense {

/// A loss that is within so many standard errors of nothing is none.
inline constexpr double kLossEvidence = 3;

class LossesByCurrent {
 public:
  void add(double power_W, double torque_Nm, double speed_rad_s);
  void end_block();
  struct Found {
    Estimate ratio;  ///< of the torque of the power to that of the current
    FoundLosses losses;
  };
  /// Nothing where the run does not show them apart.
  [[nodiscard]] std::optional<Found> found(double least_known_from_rad_s) const;

 private:
  struct Row {
    double power = 0, shaft = 0, square = 0;
  };
  double n_ = 0;
  Row sum_;
  std::vector<Row> rows_;
  double largest_Nm_ = 0, highest_rad_s_ = 0;
};

}  // namespace servosense
