#include "servosense/process/tool/sweep.hpp"

#include <algorithm>
#include <cmath>

namespace servosense::process {
namespace {

/// a s^2 + b s + c.
struct Quadratic {
  double a = 0, b = 0, c = 0;
  [[nodiscard]] double at(double s) const { return (a * s + b) * s + c; }
};

/// Greatest p s + sqrt(q(s)) on [low, high], where q >= 0 and sqrt(q) is concave.
double greatest(double p, const Quadratic& q, double low, double high) {
  const auto value = [&](double s) { return p * s + std::sqrt(std::max(0.0, q.at(s))); };
  double best = std::max(value(low), value(high));
  const auto look_at = [&](double s) {
    if (s > low && s < high) best = std::max(best, value(s));
  };
  if (q.a != 0) {
    const double middle = -q.b / (2 * q.a);
    const double d = q.a - p * p;
    const double square = d != 0 ? (4 * q.a * q.c - q.b * q.b) / d : -1;
    if (square > 0) {
      const double away = std::abs(p) / (2 * std::abs(q.a)) * std::sqrt(square);
      look_at(middle - away);
      if (away > 0) look_at(middle + away);
    }
  } else if (p != 0 && q.b != 0) {
    look_at((q.b * q.b / (4 * p * p) - q.c) / q.b);
  }
  return best;
}

/// Narrows [low, high] to where a + b s >= 0; false if nothing is left.
bool keep_positive(double a, double b, double& low, double& high) {
  if (b > 0)
    low = std::max(low, -a / b);
  else if (b < 0)
    high = std::min(high, -a / b);
  else if (a < 0)
    return false;
  return low <= high;
}

/// Narrows [low, high] to where q >= 0, q.a < 0 or q constant.
bool keep_positive(const Quadratic& q, double& low, double& high) {
  if (!(q.a < 0)) return keep_positive(q.c, q.b, low, high);
  const double square = q.b * q.b - 4 * q.a * q.c;
  if (square < 0) return false;
  const double root = std::sqrt(square);
  low = std::max(low, (-q.b + root) / (2 * q.a));
  high = std::min(high, (-q.b - root) / (2 * q.a));
  return low <= high;
}

/// Halvings of a stretch of the path: a least height is then known to 1e-6 of its slope over it.
constexpr int kHalvings = 20;

}  // namespace

Sweep::Sweep(const Cutter& cutter, const Point& from, const Point& to)
    : cutter_(&cutter), from_(from), to_(to) {
  for (std::size_t i = 0; i < 3; ++i) move_[i] = to[i] - from[i];
  level_length2_ = move_[0] * move_[0] + move_[1] * move_[1];
  level_ = move_[2] == 0;
  lowest_ = std::min(from[2], to[2]);
  if (level_length2_ > 0) per_length2_ = 1 / level_length2_;
  ball_ = cutter.has_ball() && cutter.frusta().size() == 1 &&
          cutter.frusta()[0].low_radius_m == cutter.radius_m();
  length_ = std::sqrt(level_length2_ + move_[2] * move_[2]);
  if (length_ > 0)
    for (std::size_t i = 0; i < 3; ++i) unit_[i] = move_[i] / length_;
}

double Sweep::low_z(double x, double y) const {
  if (!ball_) {
    const Interval in = along_z(x, y);
    return in.empty() ? kNowhere : in.low;
  }
  // The lower side of a cylinder about the way of the ball's centre, or of the ball at an end of
  // it.
  const double dx = x - from_[0], dy = y - from_[1], square = dx * dx + dy * dy;
  const double r2 = cutter_->radius_m() * cutter_->radius_m();
  const double nearest = std::clamp((dx * move_[0] + dy * move_[1]) * per_length2_, 0.0, 1.0);
  const double ox = dx - nearest * move_[0], oy = dy - nearest * move_[1];
  if (ox * ox + oy * oy > r2) return kNowhere;
  const auto of_end = [&](const Point& end) {
    const double ex = x - end[0], ey = y - end[1];
    return end[2] + cutter_->radius_m() - std::sqrt(std::max(0.0, r2 - ex * ex - ey * ey));
  };
  if (level_length2_ == 0) return of_end(from_[2] < to_[2] ? from_ : to_);
  const double h = dx * unit_[0] + dy * unit_[1],
               level2 = unit_[0] * unit_[0] + unit_[1] * unit_[1];
  const double under = unit_[2] * unit_[2] * h * h - level2 * (square - h * h - r2);
  const double z = (unit_[2] * h - std::sqrt(std::max(0.0, under))) / level2;
  const double along = h + z * unit_[2];
  if (along < 0) return of_end(from_);
  if (along > length_) return of_end(to_);
  return from_[2] + cutter_->radius_m() + z;
}

Interval Sweep::bounds(std::size_t axis) const {
  const double low = std::min(from_[axis], to_[axis]), high = std::max(from_[axis], to_[axis]);
  if (axis == 2) return {low + cutter_->bottom_m(), high + cutter_->top_m()};
  return {low - cutter_->radius_m(), high + cutter_->radius_m()};
}

Interval Sweep::along_z(double x, double y) const {
  const double dx = x - from_[0], dy = y - from_[1], radius = cutter_->radius_m();
  // Squared distance of the axis, over the path.
  const Quadratic distance2{level_length2_, -2 * (dx * move_[0] + dy * move_[1]),
                            dx * dx + dy * dy};
  double nearest = 0;
  if (level_length2_ > 0) nearest = std::clamp(-distance2.b / (2 * distance2.a), 0.0, 1.0);
  const double least2 = distance2.at(nearest);
  if (least2 > radius * radius) return {};
  const double mz = move_[2];
  if (level_)
    return {from_[2] + cutter_->surface_at(std::sqrt(std::max(0.0, least2))),
            from_[2] + cutter_->top_m()};
  double low = 0, high = 1;
  const Quadratic inside{-distance2.a, -distance2.b, radius * radius - distance2.c};
  if (!keep_positive(inside, low, high)) low = high = nearest;
  low = std::clamp(low, 0.0, 1.0), high = std::clamp(high, low, 1.0);
  const double top = from_[2] + cutter_->top_m() + std::max(mz * low, mz * high);
  if (ball_) return {low_z(x, y), top};
  const auto distance = [&](double s) { return std::sqrt(std::max(0.0, distance2.at(s))); };
  const auto height = [&](double s) { return mz * s + cutter_->surface_at(distance(s)); };
  const auto rises = [&](double s) {
    const double d = distance(s), turn = distance2.a * s + distance2.b / 2;
    if (turn == 0) return mz > 0;
    const double slope = cutter_->slope_at(d);
    return slope == 0 ? mz > 0 : mz + slope * turn / std::max(d, 1e-300) > 0;
  };
  double s = low;
  if (!rises(low)) {
    s = high;
    if (rises(high)) {
      double a = low, b = high;
      for (int i = 0; i < kHalvings; ++i) {
        s = (a + b) / 2;
        (rises(s) ? b : a) = s;
      }
    }
  }
  return {from_[2] + std::min({height(s), height(low), height(high)}), top};
}

/// Of discs of one radius with their centres on a stretch of the path.
Interval Sweep::disc(std::size_t axis, double across, double radius, double s_low,
                     double s_high) const {
  const double mv = move_[1 - axis], w = across - from_[1 - axis];
  double low = s_low, high = s_high;
  if (!keep_positive(radius + w, -mv, low, high) || !keep_positive(radius - w, mv, low, high))
    return {};
  const Quadratic q{-mv * mv, 2 * w * mv, radius * radius - w * w};
  return {from_[axis] - greatest(-move_[axis], q, low, high),
          from_[axis] + greatest(move_[axis], q, low, high)};
}

Interval Sweep::shadow(std::size_t axis, double across, double margin) const {
  return disc(axis, across, cutter_->radius_m() + margin, 0, 1);
}

Interval Sweep::along_frustum(std::size_t axis, double across, double z,
                              const Cutter::Frustum& f) const {
  const double mv = move_[1 - axis], w = across - from_[1 - axis];
  const double mz = move_[2], height = z - from_[2];
  double low = 0, high = 1;
  if (!keep_positive(height - f.low_m, -mz, low, high) ||
      !keep_positive(f.high_m - height, mz, low, high))
    return {};
  // Radius over the path, and how far it reaches beyond the line on either side.
  const double widening = (f.high_radius_m - f.low_radius_m) / (f.high_m - f.low_m);
  const double r = f.low_radius_m + widening * (height - f.low_m), dr = -widening * mz;
  if (!keep_positive(r + w, dr - mv, low, high) || !keep_positive(r - w, dr + mv, low, high))
    return {};
  const Quadratic q{dr * dr - mv * mv, 2 * (r * dr + w * mv), r * r - w * w};
  return {from_[axis] - greatest(-move_[axis], q, low, high),
          from_[axis] + greatest(move_[axis], q, low, high)};
}

Interval Sweep::along_ball(std::size_t axis, double across, double z) const {
  const auto& nose = *cutter_->nose();
  const double mv = move_[1 - axis], w = across - from_[1 - axis];
  const double mz = move_[2], height = z - from_[2], r = nose.corner_m;
  double low = 0, high = 1;
  if (!keep_positive(height, -mz, low, high) || !keep_positive(nose.high_m - height, mz, low, high))
    return {};
  const double h = height - r;
  const Quadratic q{-mv * mv - mz * mz, 2 * (w * mv + h * mz), r * r - w * w - h * h};
  if (!keep_positive(q, low, high)) return {};
  return {from_[axis] - greatest(-move_[axis], q, low, high),
          from_[axis] + greatest(move_[axis], q, low, high)};
}

double Sweep::radius_passing(double z) const {
  const double lowest = z - std::max(from_[2], to_[2]), highest = z - std::min(from_[2], to_[2]);
  if (highest < cutter_->bottom_m() || lowest > cutter_->top_m()) return -1;
  return cutter_->radius_at(std::min(highest, cutter_->top_m()));
}

Interval Sweep::along(std::size_t axis, double across, double z) const {
  const double height = z - from_[2];
  if (level_) {
    const double radius = cutter_->radius_at(height);
    return radius < 0 ? Interval{} : disc(axis, across, radius, 0, 1);
  }
  if (level_length2_ == 0) {  // a plunge: the widest that passes this height
    const double radius = radius_passing(z);
    return radius < 0 ? Interval{} : disc(axis, across, radius, 0, 0);
  }
  Interval all;
  if (cutter_->has_ball())
    all.add(along_ball(axis, across, z));
  else
    for (const auto& f : cutter_->nose_frusta()) all.add(along_frustum(axis, across, z, f));
  for (const auto& f : cutter_->frusta()) all.add(along_frustum(axis, across, z, f));
  return all;
}

}  // namespace servosense::process
