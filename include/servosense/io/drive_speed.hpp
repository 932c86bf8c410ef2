// The speed of a drive from sample to sample, smoothed without lag in a ramp.
//
// Level and slope of Holt (1957) with the gains of double exponential smoothing (Brown 1963):
//   e = x - (level + slope), level += slope + (1 - q^2) e, slope += (1 - q)^2 e, q = exp(-T / tau)
// Samples further apart than tau are taken as they are. Host code.
#pragma once

#include <cmath>

namespace servosense {

class DriveSpeed {
 public:
  /// `mean`: each value is the mean speed since the sample before, else the speed at the sample.
  DriveSpeed(double sample_period_s, bool mean) : mean_(mean) {
    const double q = std::exp(-sample_period_s / kTau_s);
    level_gain_ = 1 - q * q;
    slope_gain_ = (1 - q) * (1 - q);
  }
  /// The speed at this sample, in the unit of `speed`.
  double process(double speed) {
    if (!started_) level_ = speed;
    started_ = true;
    const double error = speed - level_ - slope_;
    level_ += slope_ + level_gain_ * error;
    slope_ += slope_gain_ * error;
    return mean_ ? level_ + slope_ / 2 : level_;
  }

 private:
  static constexpr double kTau_s = 5e-3;  // counts of 4096 a turn tell 0.3 rad/s over it
  bool mean_;
  double level_gain_, slope_gain_;
  double level_ = 0, slope_ = 0;
  bool started_ = false;
};

}  // namespace servosense
