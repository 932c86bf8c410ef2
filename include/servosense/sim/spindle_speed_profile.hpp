// Spindle speed against time: straight lines between points, held before the first and after the
// last. A linear ramp is two points, a constant speed one.
#pragma once

#include <cstddef>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

struct SpindleSpeedProfile {
  struct Point {
    double time_s = 0;
    double speed_rpm = 0;
  };
  std::vector<Point> points;  ///< ascending in time; empty: the speed of the cut

  [[nodiscard]] static SpindleSpeedProfile constant(double speed_rpm) {
    return {{{0.0, speed_rpm}}};
  }
  /// Speed override moved at a constant rate in percent of `base_rpm` per second, from one speed
  /// to another, then held (Koike 2016, ch. 8: 9000 to 5400 rpm, base 7200, 50 %/s: one second).
  [[nodiscard]] static SpindleSpeedProfile ramp(double from_rpm, double to_rpm,
                                                double percent_per_s, double base_rpm);

  [[nodiscard]] double speed_rpm(double time_s) const;
  /// Ascending times, finite speeds above zero.
  [[nodiscard]] Expected<Done> validate() const;
};

}  // namespace servosense
