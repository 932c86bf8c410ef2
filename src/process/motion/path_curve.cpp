#include "servosense/process/motion/path_curve.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace servosense::process {
namespace {

Eigen::Vector3d xyz(const AxisPoint& p) { return {p[0], p[1], p[2]}; }
void set_xyz(AxisPoint& p, const Eigen::Vector3d& to) {
  for (std::size_t i = 0; i < 3; ++i) p[i] = to[static_cast<Eigen::Index>(i)];
}
double distance_over(const AxisPoint& a, const AxisPoint& b, std::size_t first) {
  return std::hypot(b[first] - a[first], b[first + 1] - a[first + 1], b[first + 2] - a[first + 2]);
}

}  // namespace

void PathCurve::measure() {
  const double others[] = {distance_over(from_, to_, 6), distance_over(from_, to_, 3)};
  moves_others_ = others[0] > 0 || others[1] > 0;
  if (angle_ > 0) {
    moves_xyz_ = true;
    length_ = run_up_ + std::hypot(angle_ * radius_, growth_, rise_);
    return;
  }
  length_ = distance_over(from_, to_, 0);
  moves_xyz_ = length_ > 0;
  if (!moves_xyz_) length_ = others[0] > 0 ? others[0] : others[1];
}

PathCurve PathCurve::line(const AxisPoint& from, const AxisPoint& to) {
  PathCurve curve;
  curve.from_ = from;
  curve.to_ = to;
  curve.measure();
  if (curve.moves_xyz_) curve.first_ = (xyz(to) - xyz(from)).normalized();
  return curve;
}

PathCurve PathCurve::arc(const CanonicalMove& move, const AxisPoint& from) {
  const auto axes = plane_axes(move.plane);
  const Eigen::AngleAxisd turned(move.rotation_deg * std::numbers::pi / 180,
                                 Eigen::Vector3d::UnitZ());
  const auto unit = [&](std::size_t axis) -> Eigen::Vector3d {
    return turned * Eigen::Vector3d::Unit(static_cast<Eigen::Index>(axis));
  };
  const double angle = arc_angle_rad(move, move.begin);
  const auto from_centre = [&](const AxisPoint& p) {
    return Eigen::Vector2d(p[axes[0]] - move.centre_m[0], p[axes[1]] - move.centre_m[1]);
  };
  const Eigen::Vector2d begins = from_centre(move.begin);
  PathCurve curve;
  curve.from_ = from;
  curve.to_ = move.machine;
  curve.angle_ = std::abs(angle);
  curve.radius_ = begins.norm();
  curve.growth_ = from_centre(move.end).norm() - curve.radius_;
  curve.rise_ = move.end[axes[2]] - move.begin[axes[2]];
  curve.axis_ = unit(axes[2]) * (angle < 0 ? -1 : 1);
  if (angle < 0) curve.rise_ = -curve.rise_;
  const Eigen::Vector3d out = unit(axes[0]) * begins.x() + unit(axes[1]) * begins.y();
  curve.centre_ = xyz(from) - out;
  if (!(curve.radius_ > 0) || !(curve.angle_ > 0)) return line(from, move.machine);
  curve.first_ = out / curve.radius_;
  curve.second_ = curve.axis_.cross(curve.first_);
  curve.measure();
  return curve;
}

PathCurve PathCurve::programmed(const CanonicalMove& move, const AxisPoint& from) {
  if (move.kind != CanonicalMove::Kind::arc) return line(from, move.end);
  CanonicalMove plain = move;
  plain.machine = move.end;
  plain.rotation_deg = 0;
  return arc(plain, move.begin);
}

PathCurve PathCurve::rounding(const AxisPoint& from, const AxisPoint& to,
                              const Eigen::Vector3d& centre, const Eigen::Vector3d& direction,
                              double run_up_m) {
  PathCurve curve;
  curve.from_ = from;
  curve.to_ = to;
  curve.run_up_ = run_up_m;
  const Eigen::Vector3d begins = xyz(from) + run_up_m * direction - centre;
  const Eigen::Vector3d ends = xyz(to) - centre;
  curve.centre_ = centre;
  curve.radius_ = begins.norm();
  curve.growth_ = ends.norm() - curve.radius_;
  curve.first_ = begins / curve.radius_;
  curve.axis_ = begins.cross(ends).normalized();
  curve.second_ = curve.axis_.cross(curve.first_);
  curve.angle_ = std::atan2(ends.dot(curve.second_), ends.dot(curve.first_));
  curve.measure();
  return curve;
}

Eigen::Vector3d PathCurve::arc_point(double angle) const {
  const double share = angle / angle_;
  return centre_ +
         (radius_ + growth_ * share) * (std::cos(angle) * first_ + std::sin(angle) * second_) +
         rise_ * share * axis_;
}

Eigen::Vector3d PathCurve::arc_tangent(double angle) const {
  const Eigen::Vector3d out = std::cos(angle) * first_ + std::sin(angle) * second_;
  const double radius = radius_ + growth_ * angle / angle_;
  return (radius * axis_.cross(out) + growth_ / angle_ * out + rise_ / angle_ * axis_).normalized();
}

Eigen::Vector3d PathCurve::outward(bool at_end) const {
  return at_end ? Eigen::Vector3d(std::cos(angle_) * first_ + std::sin(angle_) * second_) : first_;
}

AxisPoint PathCurve::at(double distance) const {
  distance = std::clamp(distance, 0.0, length_);
  const double share = length_ > 0 ? distance / length_ : 1;
  AxisPoint point;
  for (std::size_t i = 0; i < point.size(); ++i) point[i] = from_[i] + share * (to_[i] - from_[i]);
  if (angle_ > 0) {
    if (distance < run_up_)
      set_xyz(point, xyz(from_) + distance * tangent(0));
    else
      set_xyz(point, arc_point(angle_ * (distance - run_up_) / (length_ - run_up_)));
  }
  return point;
}

Eigen::Vector3d PathCurve::tangent(double distance) const {
  if (angle_ > 0)
    return arc_tangent(angle_ * std::clamp((distance - run_up_) / (length_ - run_up_), 0.0, 1.0));
  return moves_xyz_ ? first_ : Eigen::Vector3d::Zero();
}

std::array<double, 2> PathCurve::extent(std::size_t axis) const {
  std::array<double, 2> in = {std::min(from_[axis], to_[axis]), std::max(from_[axis], to_[axis])};
  if (!(angle_ > 0)) return in;
  // Over a turn a spiral or a helix grows by the same everywhere: the extremes are in its first or
  // last. There its slope is followed in sixteenths of a half turn.
  constexpr double turn = 2 * std::numbers::pi, piece = turn / 32;
  const auto k = static_cast<Eigen::Index>(axis);
  const auto slope = [&](double angle) { return arc_tangent(angle)[k]; };
  for (const double first : {0.0, std::max(0.0, angle_ - turn)})
    for (double low = first; low < std::min(angle_, first + turn); low += piece) {
      double a = low, b = std::min(low + piece, angle_);
      const bool rises = slope(a) > 0;
      if (rises != (slope(b) > 0))
        for (int i = 0; i < 40; ++i) ((slope((a + b) / 2) > 0) == rises ? a : b) = (a + b) / 2;
      for (const double angle : {a, b}) {
        const double at = arc_point(angle)[k];
        in = {std::min(in[0], at), std::max(in[1], at)};
      }
    }
  return in;
}

double PathCurve::chord_m(double tolerance_m) const {
  return 2 * std::sqrt(2 * std::max(radius_, radius_ + growth_) * tolerance_m);
}

PathCurve::Circle PathCurve::circle(bool at_end) const {
  const Eigen::Vector3d centre =
      centre_ + (at_end ? rise_ : 0) * axis_ + growth_ / angle_ * arc_tangent(at_end ? angle_ : 0);
  return {centre, (arc_point(at_end ? angle_ : 0) - centre).norm()};
}

double PathCurve::planar_radius() const {
  // Of r(phi) = r0 + g phi at its smaller end.
  const double r = std::min(radius_, radius_ + growth_), g = growth_ / angle_;
  const double square = r * r + g * g;
  return square * std::sqrt(square) / (square + g * g);
}

void PathCurve::cut_start(double by) {
  if (angle_ > 0) {
    const double share = by / angle_;
    set_xyz(from_, arc_point(by));
    centre_ += rise_ * share * axis_;
    const Eigen::Vector3d out = std::cos(by) * first_ + std::sin(by) * second_;
    radius_ += growth_ * share;
    growth_ *= 1 - share;
    rise_ *= 1 - share;
    angle_ -= by;
    first_ = out;
    second_ = axis_.cross(first_);
  } else {
    from_ = at(by);
  }
  measure();
}

void PathCurve::cut_end(double by) {
  if (angle_ > 0) {
    const double share = by / angle_;
    set_xyz(to_, arc_point(angle_ - by));
    growth_ *= 1 - share;
    rise_ *= 1 - share;
    angle_ -= by;
  } else {
    to_ = at(length_ - by);
  }
  measure();
}

}  // namespace servosense::process
