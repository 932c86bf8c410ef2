// The torque of a drive that reports a power or a load, row by row: what its speed makes of it.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>

#include "servosense/io/drive_columns.hpp"
#include "servosense/io/drive_speed.hpp"

namespace servosense {

class LoadTorque {
 public:
  /// Smoothed [rad/s], after a motion [rad, or rad/s where the columns have a speed] at a time.
  double speed_rad_s(const DriveColumns& columns, double period_s, double t_s,
                     std::optional<double> motion) {
    if (columns.constant_motion != 0) {
      speed_rad_s_ = columns.constant_motion;
    } else if (motion) {
      const bool speed = columns.signal.motion == MotionKind::velocity;
      if (!smooth_) {
        smooth_.emplace(period_s, !speed);
        moved_at_s_ = t_s - period_s;
        moved_rad_ = *motion;
      }
      const double periods = std::max(1.0, std::round((t_s - moved_at_s_) / period_s));
      speed_rad_s_ =
          smooth_->process(speed ? *motion : (*motion - moved_rad_) / (periods * period_s));
      moved_at_s_ = t_s;
      moved_rad_ = *motion;
    }
    return speed_rad_s_;
  }
  /// [Nm] of an effort in the unit of the columns, at a speed.
  [[nodiscard]] static double torque_Nm(const DriveColumns& columns, double effort,
                                        double speed_rad_s) {
    if (!columns.power) return faded_torque(effort, speed_rad_s, columns.rated_to_rad_s);
    const PowerReading& power = *columns.power;
    return (power.is_unsigned ? power.without_losses() : power).torque_Nm(effort, speed_rad_s);
  }

 private:
  std::optional<DriveSpeed> smooth_;
  double speed_rad_s_ = 0;
  double moved_at_s_ = 0, moved_rad_ = 0;  // the last motion
};

}  // namespace servosense
