// Reference motion: jerk-limited moves, dwells, sines and cruises in a row.
//
// A move from rest to rest has up to seven segments of constant jerk: +j 0 -j, cruise, -j 0 +j.
// With limits v, a, j and distance d the speed it reaches is
//   V = v                                       if there is room:  d >= v t(v)
//   V = (sqrt(a^4 + 4 a d j^2) - a^2) / (2 j)   else, if V >= a^2/j (acceleration reaches a)
//   V = (d^2 j / 4)^(1/3)                       else
// with t(V) = V/a + a/j, or 2 sqrt(V/j) where V < a^2/j, the time to reach it; the move takes
// d/V + t(V). All values are closed forms of time, so nothing accumulates and the end is exact.
// Units: m for an axis, rad for a spindle.
#pragma once

#include <cstddef>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

struct MotionPoint {
  double position = 0;
  double velocity = 0;
  double acceleration = 0;
  double jerk = 0;
};

/// All positive.
struct MotionLimits {
  double velocity = 0;      ///< m/s or rad/s
  double acceleration = 0;  ///< m/s2 or rad/s2
  double jerk = 0;          ///< m/s3 or rad/s3
};

/// Fastest motion over a distance, from rest to rest, within limits.
class JerkLimitedMove {
 public:
  /// Usage error for limits that are not positive, or a distance that is not finite.
  static Expected<JerkLimitedMove> plan(double distance, const MotionLimits& limits);

  [[nodiscard]] double duration_s() const { return 2 * ramp_s_ + cruise_s_; }
  /// Time from rest to the speed that is reached.
  [[nodiscard]] double ramp_s() const { return ramp_s_; }
  [[nodiscard]] double distance() const { return distance_; }
  /// Position from the start of the move; at rest before and after.
  [[nodiscard]] MotionPoint at(double t_s) const;

 private:
  [[nodiscard]] MotionPoint ramp(double t_s) const;

  double distance_ = 0;
  double direction_ = 1;
  double velocity_ = 0;      // reached
  double acceleration_ = 0;  // reached
  double jerk_ = 0;
  double jerk_s_ = 0;  // duration of each jerk segment
  double ramp_s_ = 0;
  double cruise_s_ = 0;
};

/// Motions in a row, each from rest to rest.
class Trajectory {
 public:
  explicit Trajectory(double start = 0) : end_(start), start_(start) {}

  /// Jerk-limited move to `target`, at feed `limits.velocity`. Usage error as for JerkLimitedMove.
  Expected<Done> move_to(double target, const MotionLimits& limits);
  /// Stands still. Usage error for a negative duration.
  Expected<Done> dwell(double duration_s);
  /// Runs up within `limits` to `velocity` (of either sign), holds it for `duration_s`, runs down.
  /// Usage error if the velocity is zero or beyond its limit, or the duration negative.
  Expected<Done> cruise(double velocity, double duration_s, const MotionLimits& limits);
  /// amplitude (1 - cos 2 pi f t): starts and ends at rest in the same place, its acceleration
  /// begins with a step. Usage error unless frequency and number of cycles are positive.
  Expected<Done> sine(double amplitude, double frequency_hz, unsigned cycles);

  [[nodiscard]] double duration_s() const { return duration_s_; }
  [[nodiscard]] double end() const { return end_; }
  /// Standing at the start before, and at the end after.
  [[nodiscard]] MotionPoint at(double t_s) const;

 private:
  struct Part {
    double from_s = 0;
    double start = 0;
    JerkLimitedMove move;  // of no distance for a dwell
    double amplitude = 0;  // of a sine
    double frequency_rad_s = 0;
  };
  void add(Part part, double duration_s, double end);

  std::vector<Part> parts_;
  double duration_s_ = 0;
  double end_;
  double start_;
};

}  // namespace servosense
