#include "corner.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace servosense::process {
namespace {

using Eigen::Vector3d;
constexpr double kPi = std::numbers::pi;

// LinuxCNC 2.9's own limits (tp_types.h, tc.c, ini defaults).
constexpr double kSameDirection = 1e-6;      // of unit vectors [rad]
constexpr double kReversal = 2 * kPi / 180;  // sharper than this: stop
constexpr double kKinkShare = 0.1;           // ARC_BLEND_KINK_RATIO
constexpr double kGapCycles = 4;             // ARC_BLEND_GAP_CYCLES
constexpr double kToleranceShare = 0.25;     // of a length without G64 P, and at most
constexpr double kShortestRadius = 1e-15;
constexpr double kShortestRounding = 1e-9;
constexpr double kRounded = 1e-9;  // share of a length that arithmetic may lose

Vector3d point(const AxisPoint& p) { return {p[0], p[1], p[2]}; }

double planned_speed(const PathSegment& s) {
  return s.with_spindle ? s.top_m_s : std::min(s.planned_m_s, s.top_m_s);
}

/// Half of the angle that the path leaves between both directions: pi/2 goes straight on.
double half_angle(const Vector3d& u1, const Vector3d& u2) {
  return std::acos(std::clamp(-u1.dot(u2), -1.0, 1.0)) / 2;
}

/// Direction of the acceleration where a segment is left; of an arc without its rise.
Vector3d leaving_direction(const PathSegment& s) {
  return s.curve.is_arc() ? Vector3d(s.curve.axis().cross(s.curve.outward(true)))
                          : s.curve.tangent(0);
}
/// Where it is entered; an arc at half its speed also turns.
Vector3d entering_direction(const PathSegment& s) {
  if (!s.curve.is_arc()) return s.curve.tangent(0);
  const Vector3d out = s.curve.outward(false);
  const double half = s.planned_m_s / 2;
  return (s.curve.axis().cross(out) * s.acceleration_m_s2 -
          out * (half * half / s.curve.radius_m()))
      .normalized();
}

/// What a box of axis limits leaves for any direction in the plane across `normal`.
double in_plane(const Vector3d& normal, const std::array<double, 3>& limits) {
  double least = kNoLimit;
  for (std::size_t i = 0; i < 3; ++i) {
    const double across = normal[static_cast<Eigen::Index>(i)];
    const double seen = std::sqrt(std::max(1 - across * across, 0.0));
    if (seen > 1e-12) least = std::min(least, limits[i] / seen);
  }
  return least;
}

/// A leg of a corner: a straight line, or the circle that fits at the corner.
struct Leg {
  bool round = false, first = false;
  Vector3d direction;  // of travel at the corner
  Vector3d inward;     // of a line: towards the rounding's centre
  Vector3d centre;     // of a circle, from the corner
  double radius = 0;
  bool inside = false;     // the rounding lies within the circle
  double angle_limit = 0;  // of a circle: what may be cut off it
};

Leg leg_of(const PathSegment& segment, bool first, const Vector3d& corner, const Vector3d& tangent,
           const Vector3d& other, const Vector3d& normal, double half) {
  Leg leg;
  leg.first = first;
  leg.direction = tangent;
  leg.inward = normal.cross(tangent);
  leg.round = segment.curve.is_arc();
  if (!leg.round) return leg;
  const auto circle = segment.curve.circle(first);
  leg.centre = circle.centre - corner;
  leg.radius = circle.radius;
  const double towards = -leg.centre.dot(other);
  leg.inside = first ? towards < 0 : towards >= 0;
  leg.angle_limit = std::min(segment.curve.angle_rad() * (first ? 2.0 / 3 : 1.0 / 3),
                             leg.inside ? half : kPi / 2);
  return leg;
}

/// How much of the leg a rounding may take.
double free_length(const Leg& leg, const PathSegment& segment) {
  if (!leg.round)
    return leg.first ? std::min(segment.curve.length(), segment.nominal_m / 2)
                     : segment.curve.length() / 2;
  return (leg.inside ? std::sin(leg.angle_limit / 4) : leg.angle_limit) * leg.radius;
}

/// Centre, from the corner, of the circle of `radius` that touches both legs; nothing where there
/// is none.
std::optional<Vector3d> touching_centre(const Leg& a, const Leg& b, double radius,
                                        const Vector3d& normal) {
  const auto distance = [&](const Leg& leg) {
    return leg.inside ? leg.radius - radius : leg.radius + radius;
  };
  if (!a.round && !b.round) {
    const Vector3d middle = b.direction - a.direction;
    return Vector3d(middle.normalized() * radius / std::sin(half_angle(a.direction, b.direction)));
  }
  if (a.round && b.round) {
    const Vector3d between = b.centre - a.centre;
    const double apart = between.norm(), da = distance(a), db = distance(b);
    if (!(apart > 0)) return std::nullopt;
    const double along = (da * da - db * db + apart * apart) / (2 * apart);
    const double square = da * da - along * along;
    if (square < 0) return std::nullopt;
    const Vector3d foot = a.centre + between / apart * along;
    const Vector3d side = normal.cross(between / apart) * std::sqrt(square);
    const Vector3d one = foot + side, other = foot - side;
    return one.norm() < other.norm() ? one : other;
  }
  const Leg &line = a.round ? b : a, &arc = a.round ? a : b;
  // corner + s direction + radius inward, at distance(arc) from the arc's centre.
  const double along = arc.centre.dot(line.direction);
  const double off = radius - arc.centre.dot(line.inward), d = distance(arc);
  const double square = d * d - off * off;
  if (square < 0) return std::nullopt;
  const double s1 = along + std::sqrt(square), s2 = along - std::sqrt(square);
  const double s = std::abs(s1) < std::abs(s2) ? s1 : s2;
  return Vector3d(line.direction * s + line.inward * radius);
}

/// What the rounding cuts off a leg: a length, or an angle of a circle.
double cut_off(const Leg& leg, const Vector3d& centre) {
  if (!leg.round) return std::abs(centre.dot(leg.direction));
  const Vector3d to_corner = -leg.centre.normalized();
  return std::acos(std::clamp((centre - leg.centre).normalized().dot(to_corner), -1.0, 1.0));
}

struct RoundedCorner {
  PathSegment before, after, rounding;
  bool swallows_before = false;
};

/// The corner cut off by an arc; nothing where none fits.
std::optional<RoundedCorner> round_off(const PathSegment& before, const PathSegment& after,
                                       const Vector3d& u1, const Vector3d& u2,
                                       const MotionLimits& limits) {
  const double half = half_angle(u1, u2);
  if (kPi / 2 - half < kSameDirection || half < kSameDirection) return std::nullopt;
  const Vector3d normal = u1.cross(u2).normalized();
  const Vector3d corner = point(after.curve.from());
  const Leg a = leg_of(before, true, corner, u1, u2, normal, half);
  const Leg b = leg_of(after, false, corner, u2, u1, normal, half);
  for (const auto* s : {&before, &after})
    if (s->curve.is_arc() && s->curve.axis().cross(normal).norm() > kSameDirection)
      return std::nullopt;  // a helix, or another plane
  double theta = half;
  if (a.inside) theta = std::min(theta, half - a.angle_limit / 4);
  if (b.inside) theta = std::min(theta, half - b.angle_limit / 4);
  if (a.round && b.round && theta < kPi / 12) return std::nullopt;
  const double phi = kPi - 2 * theta;

  const auto tolerance_of = [](const PathSegment& s) {
    return std::min(s.tolerance_m > 0 ? s.tolerance_m : kNoLimit, s.nominal_m * kToleranceShare);
  };
  const double tolerance = std::min(tolerance_of(before), tolerance_of(after));
  const double acceleration = in_plane(normal, limits.acceleration_m_s2);
  const double across = acceleration * kNormalShare;
  double speed_limit = in_plane(normal, limits.velocity_m_s);
  if (!a.round && !b.round) {
    // The velocity turns from one axis-limited vector to the other.
    const double cosine = std::cos(std::min(phi, kPi * 0.49));
    const double v1 = std::min(before.top_m_s, after.top_m_s / cosine);
    const double v2 = std::min(after.top_m_s, before.top_m_s / cosine);
    speed_limit = std::max(speed_limit, v1 * v2 * std::sin(phi) / (u2 * v2 - u1 * v1).norm());
  }
  const double wanted = std::max(planned_speed(before), planned_speed(after));
  const double goal = std::min(wanted, speed_limit);

  const double reach = std::min({free_length(a, before), free_length(b, after),
                                 std::cos(theta) * tolerance / (1 - std::sin(theta))});
  const double widest = std::tan(theta) * reach;
  const double speed = std::min(std::sqrt(across * widest), goal);
  // No wider than what overlapping accelerations would take at that speed.
  const double overlap = acceleration / 2;
  const double seconds = std::min(std::sqrt(2 * overlap * reach), speed) / overlap;
  const double radius = std::max(speed * speed / across, std::min(seconds * speed / phi, widest));
  if (!(radius > kShortestRadius) || !(radius * phi > kShortestRounding)) return std::nullopt;

  const auto centre = touching_centre(a, b, radius, normal);
  if (!centre || ((a.round || b.round) && centre->norm() - radius > tolerance)) return std::nullopt;
  double cut_before = cut_off(a, *centre), cut_after = cut_off(b, *centre);
  if ((a.round && cut_before > a.angle_limit) || (b.round && cut_after > b.angle_limit))
    return std::nullopt;
  const auto fits = [](const PathSegment& s, double& cut) {
    const double whole = s.curve.is_arc() ? s.curve.angle_rad() : s.curve.length();
    if (cut > whole * (1 + kRounded)) return false;
    cut = std::min(cut, whole);
    return true;
  };
  if (!fits(before, cut_before) || !fits(after, cut_after)) return std::nullopt;

  RoundedCorner made{before, after, {}, false};
  made.before.curve.cut_end(cut_before);
  made.after.curve.cut_start(cut_after);
  const double left = made.before.curve.length();
  made.swallows_before =
      !a.round && ((left < kGapCycles * limits.cycle_s * speed && !before.parabola_before) ||
                   left < kRounded * before.nominal_m);
  PathSegment& arc = made.rounding;
  arc = before;
  arc.marks.clear();
  arc.curve = PathCurve::rounding(
      made.swallows_before ? before.curve.from() : made.before.curve.to(), made.after.curve.from(),
      corner + *centre, u1, made.swallows_before ? left : 0);
  arc.nominal_m = arc.curve.length();
  arc.rounding = true;
  arc.feed_m_s = std::max(before.target_m_s(), after.target_m_s());
  arc.planned_m_s = wanted;
  arc.top_m_s = speed;
  arc.acceleration_m_s2 = acceleration;
  arc.jerk_m_s3 = in_plane(normal, limits.jerk_m_s3);
  arc.tangential_share = kTangentialShare;
  arc.joint = Joint::tangent;
  arc.parabola_before = false;
  arc.kink_m_s = kNoLimit;
  arc.kink_share_before = made.swallows_before ? before.kink_share_before : 0;
  arc.kink_share_after = 0;
  return made;
}

void set_joint(PathSegment& before, PathSegment& after, Joint joint) {
  before.joint = joint;
  after.parabola_before = joint == Joint::parabola;
}

}  // namespace

OverlapSpeeds overlap_speeds(const PathSegment& before, const PathSegment& after,
                             double target_before, double target_after, bool cut) {
  const double a1 = before.path_acceleration(), a2 = after.path_acceleration();
  const auto reached = [&](const PathSegment& s, double a, double target) {
    return std::min(target, std::sqrt(a * s.curve.length() * (cut ? 0.5 : 1)));
  };
  const double v1 = reached(before, a1, target_before), v2 = reached(after, a2, target_after);
  // At least as long as the acceleration takes, over no more than half of either.
  const double seconds = std::min(std::min(before.curve.length() / v1, after.curve.length() / v2),
                                  std::max(v1 / a1, v2 / a2));
  OverlapSpeeds speeds;
  speeds.leaving = std::min(v1, seconds * a1);
  speeds.entered = std::min(v2, seconds * a2);
  const double theta = half_angle(leaving_direction(before), entering_direction(after));
  if (before.tolerance_m > 0 && std::cos(theta) > 1e-3) {
    const double within = 2 * std::sqrt(a1 * before.tolerance_m / std::cos(theta));
    speeds.leaving = std::min(speeds.leaving, within);
    speeds.entered = std::min(speeds.entered, within);
  }
  speeds.net = std::sin(theta) * (speeds.leaving + speeds.entered) / 2;
  return speeds;
}

Corner join(PathSegment& before, PathSegment& after, const MotionLimits& limits) {
  // Rapids and feeds do not run into each other, nor axes whose acceleration is not known.
  if (before.rapid != after.rapid || !before.curve.moves_xyz() || !after.curve.moves_xyz())
    before.joint = Joint::stop;
  if (before.joint == Joint::stop) {
    set_joint(before, after, Joint::stop);
    return {};
  }
  if (before.curve.moves_others() || after.curve.moves_others()) {
    set_joint(before, after, before.joint);
    return {};
  }
  const Vector3d u1 = before.curve.tangent(before.curve.length()), u2 = after.curve.tangent(0);
  if ((u1 + u2).norm() < kReversal) {
    set_joint(before, after, Joint::stop);
    return {};
  }
  // Straight on: the jump of the velocity within a servo period, as a share of what the axes can.
  const double speed = std::min(planned_speed(before), planned_speed(after));
  const double jump = speed / limits.cycle_s + after.acceleration_m_s2;
  double share = 0;
  for (std::size_t i = 0; i < 3; ++i)
    share = std::max(share, std::abs((u2 - u1)[static_cast<Eigen::Index>(i)]) * jump /
                                limits.acceleration_m_s2[i]);
  if (before.curve.is_arc() || after.curve.is_arc()) share /= kTangentialShare;
  const auto go_on = [&](double at, double of_acceleration) {
    before.kink_m_s = at;
    before.kink_share_after = of_acceleration;
    after.kink_share_before = of_acceleration;
    set_joint(before, after, Joint::tangent);
  };
  if (share < kKinkShare) {
    go_on(speed, share);
    return {};
  }
  if (before.joint == Joint::exact) {  // stands, and yet keeps the share back
    before.kink_share_after = after.kink_share_before = kKinkShare;
    return {};
  }
  const double kinked = speed * kKinkShare / share;
  auto rounded = round_off(before, after, u1, u2, limits);
  PathSegment slow_before = before, slow_after = after;
  slow_before.kink_share_after = slow_after.kink_share_before = kKinkShare;
  const double overlapped =
      overlap_speeds(slow_before, slow_after, planned_speed(before), planned_speed(after), true)
          .net /
      2;
  const double arced = rounded ? rounded->rounding.top_m_s : 0;
  if (rounded && arced > kinked && arced > overlapped) {
    before = std::move(rounded->before);
    after = std::move(rounded->after);
    set_joint(before, after, Joint::tangent);
    return {std::move(rounded->rounding), rounded->swallows_before};
  }
  if (kinked > overlapped)
    go_on(kinked, kKinkShare);
  else
    set_joint(before, after, Joint::parabola);
  return {};
}

}  // namespace servosense::process
