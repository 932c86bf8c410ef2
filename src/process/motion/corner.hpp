// How a control gets from one segment into the next.
//
// As LinuxCNC 2.9 does it (Ellenberg 2014): nearly straight on at speed; else whichever is fastest
// of an arc within the tolerance, of going on straight at a lower speed, and of two accelerations
// that overlap.
#pragma once

#include <cmath>
#include <optional>

#include "servosense/process/motion/path_segment.hpp"

namespace servosense::process {

/// Shares of the acceleration on a curve: half along the path, the rest of the vector across it
/// (LinuxCNC, BLEND_ACC_RATIO_TANGENTIAL).
inline constexpr double kTangentialShare = 0.5;
inline const double kNormalShare = std::sqrt(0.75);

struct Corner {
  std::optional<PathSegment> rounding;  ///< to be put between the two
  bool swallows_before = false;         ///< it stands for the rest of the first segment, too
};
/// Settles how `before` ends and `after` begins; both are shortened where a rounding comes between.
[[nodiscard]] Corner join(PathSegment& before, PathSegment& after, const MotionLimits& limits);

/// Speeds at which two segments overlap: `leaving` where the second sets out, `entered` of the
/// second when the first stands, `net` along the corner.
struct OverlapSpeeds {
  double leaving = 0, entered = 0, net = 0;
};
/// `cut`: whether the corners at their far ends may still take half of them.
[[nodiscard]] OverlapSpeeds overlap_speeds(const PathSegment& before, const PathSegment& after,
                                           double target_before, double target_after, bool cut);

}  // namespace servosense::process
