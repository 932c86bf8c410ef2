#include "servosense/process/engagement/engaged_arcs.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace servosense::process {
namespace {

constexpr double kToDegrees = 180 / std::numbers::pi;
/// No line of the lattice.
constexpr std::size_t kAir = static_cast<std::size_t>(-1);
/// Beyond the ends of what counts the cutter has just cut: an outline there is its own.
constexpr double kAtEnd = 0.01;

/// Takes `covered` out, on whichever turn it is.
void subtract(const Arc& covered, std::vector<Arc>& arcs) {
  std::vector<Arc> left;
  for (const double turn : {-360.0, 0.0, 360.0}) {
    const double low = covered.from_deg + turn, high = covered.to_deg + turn;
    left.clear();
    for (const Arc& arc : arcs) {
      if (high <= arc.from_deg || low >= arc.to_deg) {
        left.push_back(arc);
        continue;
      }
      if (low > arc.from_deg) left.push_back({arc.from_deg, low});
      if (high < arc.to_deg) left.push_back({high, arc.to_deg});
    }
    std::swap(arcs, left);
  }
}

}  // namespace

double EngagedArcs::angle_deg(double x, double y) const {
  const double dx = x - x_, dy = y - y_;
  const double sine = dx * ahead_[0] + dy * ahead_[1], cosine = dy * ahead_[0] - dx * ahead_[1];
  const double angle = std::atan2(sine, cosine) * kToDegrees;
  return angle < -90 ? angle + 360 : angle;
}

double EngagedArcs::order_of(double sine, double cosine) const {
  return cosine >= 0 ? sine : 2 - sine;
}

void EngagedArcs::set_circle(double x, double y, double radius, const std::array<double, 2>& ahead,
                             double least_sine) {
  x_ = x, y_ = y, radius_ = radius, ahead_ = ahead;
  whole_ = least_sine <= -1;
  samples_.clear();
  const auto add = [&](double dx, double dy, std::size_t axis, std::size_t across) {
    const double sine = (dx * ahead[0] + dy * ahead[1]) / radius;
    if (!(sine > least_sine)) return;
    const double cosine = (dy * ahead[0] - dx * ahead[1]) / radius;
    samples_.push_back({order_of(sine, cosine), x + dx, y + dy, axis, across});
  };
  const Workpiece& w = *workpiece_;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const double centre = axis == 0 ? y : x;
    const auto lines = w.lattice_range(1 - axis, {centre - radius, centre + radius});
    const auto cross = [&](std::size_t line, double place) {
      const double off = place - centre, half2 = radius * radius - off * off;
      if (half2 < 0) return;
      const double half = std::sqrt(half2);
      for (const double along : {-half, half})
        axis == 0 ? add(along, off, axis, line) : add(off, along, axis, line);
    };
    for (std::size_t i = lines[0]; i < lines[1]; ++i) cross(i, w.lattice(1 - axis, i));
    // One more on either side of the stock, in the air.
    cross(kAir, w.lattice(1 - axis, 0) - w.cell_m()[1 - axis]);
    cross(kAir, w.lattice(1 - axis, w.cells()[1 - axis]));
  }
  std::sort(samples_.begin(), samples_.end(),
            [](const Sample& a, const Sample& b) { return a.order < b.order; });
  const double sine = std::clamp(least_sine, -1.0, 1.0);
  const double cosine = std::sqrt(std::max(0.0, 1 - sine * sine));
  const auto end = [&](double c) {
    return Sample{order_of(sine, c), x + radius * (ahead[0] * sine - ahead[1] * c),
                  y + radius * (ahead[1] * sine + ahead[0] * c), 2, 0};
  };
  first_ = end(cosine), last_ = end(-cosine);
  if (cosine == 0) last_.order = 2 - sine;
}

bool EngagedArcs::inside(const Sample& at, std::size_t layer) const {
  if (at.across == kAir) return false;
  const Workpiece& w = *workpiece_;
  const double along = at.axis == 0 ? at.x : at.y;
  return w.lines(at.axis).holds(w.level_line(at.axis, at.across, layer),
                                static_cast<float>(along - w.origin()[at.axis]),
                                static_cast<float>(kContactDepth));
}

std::size_t EngagedArcs::outline(const Cell& cell, std::size_t layer,
                                 std::array<OutlinePoint, 2>& points) const {
  const Workpiece& w = *workpiece_;
  std::size_t found = 0;
  for (std::size_t axis = 0; axis < 2; ++axis)
    for (long side = 0; side < 2; ++side) {
      const long across = cell[1 - axis] + side;
      if (across < 0 || across >= static_cast<long>(w.cells()[1 - axis])) continue;
      const double from = (static_cast<double>(cell[axis]) + 0.5) * w.cell_m()[axis];
      const double to = from + w.cell_m()[axis];
      const auto line = static_cast<std::size_t>(across);
      for (const Stretch& s : w.lines(axis).of(w.level_line(axis, line, layer)))
        for (const double at : {static_cast<double>(s.low), static_cast<double>(s.high)}) {
          if (at < from || at > to) continue;
          if (found < 2) {
            points[found].at[axis] = w.origin()[axis] + at;
            points[found].at[1 - axis] = w.lattice(1 - axis, line);
            points[found].beyond = cell;
            points[found].beyond[1 - axis] += side == 0 ? -1 : 1;
          }
          ++found;
        }
    }
  return found;
}

std::optional<std::array<double, 2>> EngagedArcs::corner(
    const Cell& cell, std::size_t layer, const std::array<OutlinePoint, 2>& points) const {
  std::array<std::array<double, 2>, 2> direction{};
  for (std::size_t i = 0; i < 2; ++i) {
    std::array<OutlinePoint, 2> next;
    if (outline(points[i].beyond, layer, next) != 2) return {};
    const bool first = next[0].at == points[i].at;
    if (!first && next[1].at != points[i].at) return {};
    const auto& far = next[first ? 1 : 0].at;
    direction[i] = {points[i].at[0] - far[0], points[i].at[1] - far[1]};
  }
  const auto& a = direction[0];
  const auto& b = direction[1];
  const double turn = a[0] * b[1] - a[1] * b[0];
  constexpr double kSharp = 0.2;  // sine of the turn (chosen): less is a curve
  if (std::abs(turn) < kSharp * std::hypot(a[0], a[1]) * std::hypot(b[0], b[1])) return {};
  const double px = points[1].at[0] - points[0].at[0], py = points[1].at[1] - points[0].at[1];
  const double t = (px * b[1] - py * b[0]) / turn;
  const std::array<double, 2> at = {points[0].at[0] + t * a[0], points[0].at[1] + t * a[1]};
  const Workpiece& w = *workpiece_;
  for (std::size_t k = 0; k < 2; ++k) {
    const double place =
        (at[k] - w.origin()[k]) / w.cell_m()[k] - 0.5 - static_cast<double>(cell[k]);
    if (place < 0 || place > 1) return {};
  }
  return at;
}

double EngagedArcs::crossing_deg(const Sample& a, const Sample& b, std::size_t layer,
                                 double slack) const {
  const Workpiece& w = *workpiece_;
  const std::array<double, 2> middle = {(a.x + b.x) / 2, (a.y + b.y) / 2};
  Cell cell{};
  for (std::size_t k = 0; k < 2; ++k)
    cell[k] = static_cast<long>(std::floor((middle[k] - w.origin()[k]) / w.cell_m()[k] - 0.5));
  const double none = std::numeric_limits<double>::quiet_NaN();
  std::array<OutlinePoint, 2> points;
  if (outline(cell, layer, points) != 2) return none;
  std::vector<std::array<double, 2>> path = {points[0].at, points[1].at};
  if (const auto sharp = corner(cell, layer, points)) path.insert(path.begin() + 1, *sharp);
  // The crossing may lie a little before or behind the two samples, because material counts from
  // kContactDepth on: the nearest within `slack` of their distance.
  const double low = angle_deg(a.x, a.y), high = angle_deg(b.x, b.y);
  double best = none, best_off = slack * (high - low);
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    const double ex = path[i + 1][0] - path[i][0], ey = path[i + 1][1] - path[i][1];
    const double px = path[i][0] - x_, py = path[i][1] - y_;
    const double qa = ex * ex + ey * ey, qb = px * ex + py * ey,
                 qc = px * px + py * py - radius_ * radius_;
    const double square = qb * qb - qa * qc;
    if (!(qa > 0) || square < 0) continue;
    for (const double sign : {-1.0, 1.0}) {
      const double t = (-qb + sign * std::sqrt(square)) / qa;
      if ((i > 0 && t < 0) || (i + 2 < path.size() && t > 1)) continue;  // behind the corner
      const double angle = angle_deg(path[i][0] + t * ex, path[i][1] + t * ey);
      const double off = std::max({0.0, low - angle, angle - high});
      if (off < best_off) best = angle, best_off = off;
    }
  }
  return best;
}

void EngagedArcs::find(std::size_t layer, std::vector<Arc>& arcs) const {
  arcs.clear();
  if (samples_.empty()) return;
  const auto change = [&](const Sample& a, const Sample& b) {
    const double angle = crossing_deg(a, b, layer, 1);
    return std::isnan(angle) ? (angle_deg(a.x, a.y) + angle_deg(b.x, b.y)) / 2 : angle;
  };
  bool in = inside(samples_.front(), layer);
  if (in) {
    const double start = whole_ ? std::numeric_limits<double>::quiet_NaN()
                                : crossing_deg(first_, samples_.front(), layer, kAtEnd);
    arcs.push_back({std::isnan(start) ? angle_deg(first_.x, first_.y) : start, 0});
    if (whole_) arcs.back().from_deg = -90;
  }
  for (std::size_t i = 1; i < samples_.size(); ++i) {
    const bool next = inside(samples_[i], layer);
    if (next == in) continue;
    const double angle = change(samples_[i - 1], samples_[i]);
    if (next)
      arcs.push_back({angle, 0});
    else
      arcs.back().to_deg = angle;
    in = next;
  }
  if (in) {
    const double end = whole_ ? std::numeric_limits<double>::quiet_NaN()
                              : crossing_deg(samples_.back(), last_, layer, kAtEnd);
    arcs.back().to_deg = whole_ ? 270 : std::isnan(end) ? angle_deg(last_.x, last_.y) : end;
  }
  if (arcs.size() == 1 && arcs[0].from_deg == -90 && arcs[0].to_deg == 270) arcs[0] = {0, 360};
}

void EngagedArcs::take_out(const std::array<double, 2>& from, const std::array<double, 2>& to,
                           std::vector<Arc>& arcs) const {
  const double inner = radius_ - kContactDepth / 2;
  const double dx = to[0] - from[0], dy = to[1] - from[1], length = std::hypot(dx, dy);
  // Ends of the covered arc: those of the circle's first or last place, or where a straight side of
  // what it covers crosses, which belongs to a place between.
  std::vector<double> places = {0, length};
  if (length > 0) {
    const double px = x_ - from[0], py = y_ - from[1];
    const double along = (px * dx + py * dy) / length, aside = (dx * py - dy * px) / length;
    for (const double side : {-inner, inner}) {
      const double off = side - aside, half2 = radius_ * radius_ - off * off;
      if (half2 < 0) continue;
      for (const double half : {-std::sqrt(half2), std::sqrt(half2)})
        if (along + half > 0 && along + half < length) places.push_back(along + half);
    }
    std::sort(places.begin(), places.end());
  }
  std::vector<Disc> way;
  for (const double place : places) {
    const double share = length > 0 ? place / length : 0;
    way.push_back({from[0] + share * dx, from[1] + share * dy, radius_});
  }
  take_out(way, arcs);
}

void EngagedArcs::take_out(std::span<const Disc> way, std::vector<Arc>& arcs) const {
  Arc covered{0, -1};
  double last = 0;
  const auto take_covered = [&] {
    if (covered.to_deg >= covered.from_deg) subtract(covered, arcs);
    covered = {0, -1};
  };
  for (const Disc& disc : way) {
    const double inner = disc.radius - kContactDepth / 2;
    const double away = std::hypot(disc.x - x_, disc.y - y_);
    const double cosine = (away * away + radius_ * radius_ - inner * inner) / (2 * radius_ * away);
    if (!(cosine < 1) || !(inner > 0)) {
      take_covered();
      continue;
    }
    const double half = std::acos(std::max(cosine, -1.0)) * kToDegrees;
    double middle = angle_deg(disc.x, disc.y);
    if (covered.to_deg >= covered.from_deg) middle += 360 * std::round((last - middle) / 360);
    const Arc now{middle - half, middle + half};
    covered = covered.to_deg < covered.from_deg ? now
                                                : Arc{std::min(covered.from_deg, now.from_deg),
                                                      std::max(covered.to_deg, now.to_deg)};
    last = middle;
  }
  take_covered();
}

void unite(std::vector<Arc>& arcs, double gap_deg) {
  std::sort(arcs.begin(), arcs.end(),
            [](const Arc& a, const Arc& b) { return a.from_deg < b.from_deg; });
  std::size_t kept = 0;
  for (const Arc& arc : arcs) {
    if (kept > 0 && arc.from_deg <= arcs[kept - 1].to_deg + gap_deg)
      arcs[kept - 1].to_deg = std::max(arcs[kept - 1].to_deg, arc.to_deg);
    else
      arcs[kept++] = arc;
  }
  arcs.resize(kept);
}

}  // namespace servosense::process
