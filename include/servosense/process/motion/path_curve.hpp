// The shape of a piece of path: a straight line, or an arc in any plane with a rise across it and a
// radius that may change, with a straight run-up if it rounds a corner.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "servosense/process/program/canonical_move.hpp"

namespace servosense::process {

/// A piece of path in the machine's coordinates, by its length from the start.
class PathCurve {
 public:
  PathCurve() = default;
  static PathCurve line(const AxisPoint& from, const AxisPoint& to);
  /// Of G2 or G3 from where the machine stands.
  static PathCurve arc(const CanonicalMove& move, const AxisPoint& from);
  /// Of any motion in the coordinates of the program, in which it begins at `from`.
  static PathCurve programmed(const CanonicalMove& move, const AxisPoint& from);
  /// About `centre`, from `from` to `to` the short way, behind a straight run-up of `run_up_m`.
  static PathCurve rounding(const AxisPoint& from, const AxisPoint& to,
                            const Eigen::Vector3d& centre, const Eigen::Vector3d& direction,
                            double run_up_m);

  /// Over x, y, z [m]; with none of these over u, v, w; with none of those over a, b, c [deg].
  [[nodiscard]] double length() const { return length_; }
  [[nodiscard]] bool is_arc() const { return angle_ > 0; }
  /// Whether x, y or z moves; whether others do.
  [[nodiscard]] bool moves_xyz() const { return moves_xyz_; }
  [[nodiscard]] bool moves_others() const { return moves_others_; }
  [[nodiscard]] AxisPoint at(double distance) const;
  /// Unit vector of x, y, z; zero where these stand.
  [[nodiscard]] Eigen::Vector3d tangent(double distance) const;
  /// Least and greatest of x, y or z.
  [[nodiscard]] std::array<double, 2> extent(std::size_t axis) const;
  [[nodiscard]] const AxisPoint& from() const { return from_; }
  [[nodiscard]] const AxisPoint& to() const { return to_; }

  // Of an arc.
  [[nodiscard]] double angle_rad() const { return angle_; }
  [[nodiscard]] double radius_m() const { return radius_; }  ///< where it begins
  [[nodiscard]] double rise_m() const { return rise_; }
  [[nodiscard]] double run_up_m() const { return run_up_; }
  [[nodiscard]] const Eigen::Vector3d& axis() const { return axis_; }
  /// Unit vector from the axis to the start or end.
  [[nodiscard]] Eigen::Vector3d outward(bool at_end) const;
  /// Centre and radius of the circle that fits the curve at its start or end (of a spiral another
  /// than its own).
  struct Circle {
    Eigen::Vector3d centre;
    double radius;
  };
  [[nodiscard]] Circle circle(bool at_end) const;
  /// The longest chord that is off it by `tolerance_m` at most [m].
  [[nodiscard]] double chord_m(double tolerance_m) const;
  /// Least radius of curvature in the plane of the arc [m].
  [[nodiscard]] double planar_radius() const;

  /// Shorter at its start or end: by a length of a line, by an angle [rad] of an arc.
  void cut_start(double by);
  void cut_end(double by);

 private:
  [[nodiscard]] Eigen::Vector3d arc_point(double angle) const;
  [[nodiscard]] Eigen::Vector3d arc_tangent(double angle) const;
  void measure();

  AxisPoint from_{}, to_{};
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero(), first_ = Eigen::Vector3d::UnitX(),
                  second_ = Eigen::Vector3d::UnitY(), axis_ = Eigen::Vector3d::UnitZ();
  double angle_ = 0, radius_ = 0, growth_ = 0, rise_ = 0, run_up_ = 0;
  double length_ = 0;
  bool moves_xyz_ = false, moves_others_ = false;
};

}  // namespace servosense::process
