// What a cutter clears on a straight line, as intervals on lines along x, y and z.
//
// The cutter is convex, so the swept solid is, and a line meets it in one interval. The ends are
// closed forms (the extreme of s p + sqrt(Q(s)) over a stretch of the path, Q a quadratic), but for
// a bull nose on a ramp: its corner is then nose_frusta() for lines along x and y, and a bisection
// for those along z.
#pragma once

#include <array>
#include <cstddef>

#include "servosense/process/tool/cutter.hpp"

namespace servosense::process {

/// x, y, z [m].
using Point = std::array<double, 3>;

/// Of a line; empty where low > high.
struct Interval {
  double low = 1, high = 0;
  [[nodiscard]] bool empty() const { return low > high; }
  void add(const Interval& other) {
    if (other.empty()) return;
    if (empty())
      *this = other;
    else
      low = other.low < low ? other.low : low, high = other.high > high ? other.high : high;
  }
};

class Sweep {
 public:
  /// `cutter` outlives the sweep.
  Sweep(const Cutter& cutter, const Point& from, const Point& to);

  /// Interval of z over (x, y).
  [[nodiscard]] Interval along_z(double x, double y) const;
  /// Where that begins; kNowhere where it is empty. Cheaper for a ball.
  [[nodiscard]] double low_z(double x, double y) const;
  static constexpr double kNowhere = 1e30;
  /// A lower bound of it; beyond all stock outside the shadow. Cheap.
  [[nodiscard]] double above(double x, double y) const {
    const double dx = x - from_[0], dy = y - from_[1];
    const double along = (dx * move_[0] + dy * move_[1]) * per_length2_;
    const double s = along < 0 ? 0 : along > 1 ? 1 : along;
    const double ox = dx - s * move_[0], oy = dy - s * move_[1];
    return lowest_ + cutter_->surface_above(ox * ox + oy * oy);
  }
  /// Interval of x at (y, z) for axis 0, of y at (x, z) for axis 1; `across` is y or x.
  [[nodiscard]] Interval along(std::size_t axis, double across, double z) const;
  /// Interval of x or y of the shadow that the sweep casts along z, made wider by `margin` all
  /// round.
  [[nodiscard]] Interval shadow(std::size_t axis, double across, double margin) const;
  /// The largest radius that passes a height; negative if none does.
  [[nodiscard]] double radius_passing(double z) const;
  [[nodiscard]] Interval bounds(std::size_t axis) const;

  [[nodiscard]] const Cutter& cutter() const { return *cutter_; }
  [[nodiscard]] const Point& from() const { return from_; }
  [[nodiscard]] const Point& to() const { return to_; }
  [[nodiscard]] bool level() const { return level_; }
  /// Of half a ball below a cylinder.
  [[nodiscard]] bool is_ball() const { return ball_; }

 private:
  [[nodiscard]] Interval along_frustum(std::size_t axis, double across, double z,
                                       const Cutter::Frustum& f) const;
  [[nodiscard]] Interval along_ball(std::size_t axis, double across, double z) const;
  [[nodiscard]] Interval disc(std::size_t axis, double across, double radius, double s_low,
                              double s_high) const;

  const Cutter* cutter_;
  Point from_, to_, move_;
  double lowest_ = 0, per_length2_ = 0;
  double level_length2_ = 0;  // of the path seen from above, squared
  bool level_ = false;
  bool ball_ = false;  // half a ball below a cylinder
  Point unit_{};       // along the path
  double length_ = 0;
};

}  // namespace servosense::process
