// The torque of a spindle whose drive reports its power.
//
// Equation: P = T w + P0 + k T^2, the power of the shaft, a constant loss and the copper loss, so
//   T = 2 (P - P0) / (w + sqrt(w^2 + 4 k (P - P0)))   for w > 0, mirrored for w < 0.
// A loss that grows with speed is friction to the model. More power than the motor can give back
// has no such T: the root is taken as 0 there.
// Bad at: standstill. Below `known_from_rad_s` power says nothing of torque; what is given there,
// the torque at that speed in proportion to the speed, only keeps filters at peace.
#pragma once

#include <algorithm>
#include <cmath>

namespace servosense {

struct PowerLosses {
  double constant_W = 0;
  double copper_W_per_Nm2 = 0;
};

struct PowerReading {
  /// 50 rpm, a convention: 10 W there are 2 Nm.
  static constexpr double kKnownFrom_rad_s = 5;

  double known_from_rad_s = kKnownFrom_rad_s;  ///< slower, power does not tell the torque
  PowerLosses losses;
  bool is_unsigned = false;  ///< an absolute value

  /// [Nm] at a speed [rad/s].
  [[nodiscard]] double torque_Nm(double power_W, double speed_rad_s) const {
    const double w = std::max(std::abs(speed_rad_s), known_from_rad_s);
    const double left = power_W - losses.constant_W;
    const double root = std::sqrt(std::max(0.0, w * w + 4 * losses.copper_W_per_Nm2 * left));
    return 2 * left / (w + root) * speed_rad_s / w;
  }
  /// The same of what torque_Nm() makes where nothing is lost.
  [[nodiscard]] double with_losses_Nm(double torque_Nm_without, double speed_rad_s) const {
    if (speed_rad_s == 0) return 0;
    const double w = std::max(std::abs(speed_rad_s), known_from_rad_s);
    return torque_Nm(torque_Nm_without * w * w / speed_rad_s, speed_rad_s);
  }
  [[nodiscard]] PowerReading without_losses() const { return {known_from_rad_s, {}, is_unsigned}; }
};

/// A torque [Nm] that is a share of the rating at a speed [rad/s]: beyond `rated_to_rad_s` that
/// falls as 1/speed; 0: nowhere.
[[nodiscard]] inline double faded_torque(double torque_Nm, double speed_rad_s,
                                         double rated_to_rad_s) {
  const double speed = std::abs(speed_rad_s);
  return rated_to_rad_s > 0 && speed > rated_to_rad_s ? torque_Nm * rated_to_rad_s / speed
                                                      : torque_Nm;
}

}  // namespace servosense
