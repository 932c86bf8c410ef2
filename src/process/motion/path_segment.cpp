#include "servosense/process/motion/path_segment.hpp"

#include <algorithm>
#include <cmath>

#include "corner.hpp"

namespace servosense::process {
namespace {

/// What the slowest axis of a straight move leaves for the path.
double along_line(const PathCurve& curve, const std::array<double, 3>& limits) {
  if (!curve.moves_xyz()) return kNoLimit;
  double slowest = 0;
  for (std::size_t i = 0; i < 3; ++i)
    slowest = std::max(slowest, std::abs(curve.to()[i] - curve.from()[i]) / limits[i]);
  return curve.length() / slowest;
}

/// The same for an arc, whose plane goes through all directions.
double along_arc(const PathCurve& curve, double in_plane, double across) {
  const double rise = std::abs(curve.rise_m());
  const double planar = std::sqrt(curve.length() * curve.length() - rise * rise);
  return curve.length() / std::max(planar / in_plane, rise / across);
}

/// Caps the speed so that the centripetal part of `acceleration` leaves half of it along the path.
/// LinuxCNC takes the rise of the whole arc for that of a radian: a helix is driven as if it were
/// less curved than it is.
void cap_by_curvature(PathSegment& segment, double acceleration) {
  const double planar = segment.curve.planar_radius(), rise = segment.curve.rise_m();
  const double radius = planar + rise * rise / planar;
  const double most = std::sqrt(kNormalShare * acceleration * radius);
  if (segment.top_m_s > most) {
    segment.top_m_s = most;
    segment.tangential_share = kTangentialShare;
    return;
  }
  const double normal = segment.top_m_s * segment.top_m_s / radius / acceleration;
  segment.tangential_share = std::sqrt(1 - normal * normal);
}

/// A segment must be met by a servo period (LinuxCNC, TP_MIN_SEGMENT_CYCLES 1.02).
void cap_by_period(PathSegment& segment, const MotionLimits& limits) {
  segment.top_m_s = std::min(segment.top_m_s, segment.curve.length() / (1.02 * limits.cycle_s));
}

}  // namespace

double PathSegment::whole_acceleration() const {
  const double shared = parabola_before || joint == Joint::parabola ? 0.5 : 1;
  return acceleration_m_s2 * shared * (1 - std::max(kink_share_before, kink_share_after));
}
double PathSegment::path_acceleration() const {
  return whole_acceleration() * (curve.is_arc() ? tangential_share : 1);
}

PathSegment path_segment(const CanonicalMove& move, const AxisPoint& from,
                         const MotionLimits& limits) {
  PathSegment segment;
  const bool arc = move.kind == CanonicalMove::Kind::arc;
  segment.curve = arc ? PathCurve::arc(move, from) : PathCurve::line(from, move.machine);
  segment.nominal_m = segment.curve.length();
  segment.rapid = move.kind == CanonicalMove::Kind::rapid;
  segment.with_spindle = move.feed_m_rev > 0 && !segment.rapid;
  segment.tolerance_m = move.blend_m;
  segment.joint = move.path_control == PathControl::exact_stop   ? Joint::stop
                  : move.path_control == PathControl::exact_path ? Joint::exact
                                                                 : Joint::parabola;
  if (segment.curve.is_arc()) {
    const auto axes = plane_axes(move.plane);
    const auto plane = [&](const std::array<double, 3>& of) {
      return std::min(of[axes[0]], of[axes[1]]);
    };
    const auto share = [&](double in_plane, const std::array<double, 3>& of) {
      return along_arc(segment.curve, in_plane, of[axes[2]]);
    };
    const double acceleration = plane(limits.acceleration_m_s2);
    const double round = std::sqrt(kNormalShare * acceleration * segment.curve.planar_radius());
    segment.top_m_s = share(std::min(plane(limits.velocity_m_s), round), limits.velocity_m_s);
    segment.acceleration_m_s2 = share(acceleration, limits.acceleration_m_s2);
    segment.jerk_m_s3 = share(plane(limits.jerk_m_s3), limits.jerk_m_s3);
    segment.tangential_share = kTangentialShare;
  } else {
    segment.top_m_s = along_line(segment.curve, limits.velocity_m_s);
    segment.acceleration_m_s2 = along_line(segment.curve, limits.acceleration_m_s2);
    segment.jerk_m_s3 = along_line(segment.curve, limits.jerk_m_s3);
  }
  cap_by_period(segment, limits);
  const double asked = segment.rapid               ? segment.top_m_s
                       : move.feed_m_s > 0         ? move.feed_m_s
                       : segment.curve.moves_xyz() ? 0
                                                   : move.feed_deg_s;
  const double feed = std::min(asked, segment.top_m_s);
  const double override_ = segment.rapid          ? limits.rapid_override
                           : segment.with_spindle ? 1
                                                  : limits.feed_override;
  segment.feed_m_s = feed * override_;
  segment.planned_m_s = feed * std::max(1.0, override_);
  return segment;
}

void settle_speed(PathSegment& segment, const MotionLimits& limits) {
  if (segment.curve.is_arc() && !segment.rounding)
    cap_by_curvature(segment, segment.whole_acceleration());
  cap_by_period(segment, limits);
}

}  // namespace servosense::process
