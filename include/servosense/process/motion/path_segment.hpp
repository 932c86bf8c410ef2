// One piece of path that a control drives with one limit of speed and one of acceleration, and how
// it goes on into the next.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "servosense/process/motion/motion_limits.hpp"
#include "servosense/process/motion/path_curve.hpp"

namespace servosense::process {

/// How a segment ends.
enum class Joint : std::uint8_t {
  stop,      ///< stands, whatever follows
  exact,     ///< through its end: at speed if the next goes on straight, else standing
  parabola,  ///< the next sets out while this one still brakes
  tangent    ///< goes on at `leave_m_s`
};

struct PathSegment {
  /// A move of the program that is done when `share` of the segment is.
  struct Mark {
    double share;
    CanonicalMove move;
  };

  PathCurve curve;
  double nominal_m = 0;  ///< length before corners were cut off
  bool rapid = false;
  bool with_spindle = false;  ///< feed a revolution
  bool rounding = false;      ///< of a corner
  double feed_m_s = 0;        ///< what is asked for, override included
  double planned_m_s = 0;     ///< what corners are planned for: without an override below 1
  double top_m_s = 0;         ///< what axes and curvature allow
  double acceleration_m_s2 = 0, jerk_m_s3 = kNoLimit;
  double tangential_share = 1;  ///< of the acceleration, what curvature leaves
  double tolerance_m = 0;       ///< of the corner at its end; 0: none
  Joint joint = Joint::stop;
  bool parabola_before = false;
  // A corner that is passed at speed takes a share of the acceleration on both sides.
  double kink_m_s = kNoLimit, kink_share_before = 0, kink_share_after = 0;
  double earliest_s = 0;  ///< does not set out before
  std::vector<Mark> marks;

  /// Acceleration that corners leave [m/s2]; of it, what is there along the path.
  [[nodiscard]] double whole_acceleration() const;
  [[nodiscard]] double path_acceleration() const;
  [[nodiscard]] double target_m_s() const { return std::min(feed_m_s, top_m_s); }
};

/// A straight or circular move; `from` is where the machine stands.
[[nodiscard]] PathSegment path_segment(const CanonicalMove& move, const AxisPoint& from,
                                       const MotionLimits& limits);
/// Holds an arc to what its curvature allows, once the corners at both ends are known, and any
/// segment to two servo periods.
void settle_speed(PathSegment& segment, const MotionLimits& limits);

}  // namespace servosense::process
