#include <algorithm>
#include <cmath>
#include <limits>

#include "servosense/sim/machined_surface.hpp"

namespace servosense {
namespace {

constexpr double kNever = std::numeric_limits<double>::quiet_NaN();
constexpr double kNear_rad = kPi / 12;  // beyond, a tip is R/30 off the wall
constexpr std::size_t kSamplingLengths = 5;

// Within kNear_rad the first term left out is below 5e-18.
double small_sine(double a) {
  const double b = a * a;
  return a * (1 - b / 6 * (1 - b / 20 * (1 - b / 42 * (1 - b / 72 * (1 - b / 110)))));
}
double small_cosine(double a) {
  const double b = a * a;
  return 1 - b / 2 * (1 - b / 12 * (1 - b / 30 * (1 - b / 56 * (1 - b / 90 * (1 - b / 132)))));
}

}  // namespace

WallProfile WallProfile::between(double from_m, double to_m) const {
  WallProfile part;
  part.spacing_m = spacing_m;
  const auto count = static_cast<double>(height_m.size());
  const double first = std::clamp(std::ceil((from_m - first_x_m) / spacing_m), 0.0, count);
  const double last = std::clamp(std::floor((to_m - first_x_m) / spacing_m) + 1, first, count);
  part.first_x_m = first_x_m + first * spacing_m;
  part.height_m.assign(height_m.begin() + static_cast<std::ptrdiff_t>(first),
                       height_m.begin() + static_cast<std::ptrdiff_t>(last));
  return part;
}

Expected<Roughness> roughness(const WallProfile& profile) {
  const std::vector<double>& z = profile.height_m;
  if (z.size() < 10 * kSamplingLengths)
    return data_error("the wall profile has " + std::to_string(z.size()) +
                      " points, roughness needs at least 50: take a longer evaluation length");
  double mean = 0, moment = 0, spread = 0;
  const double middle = static_cast<double>(z.size() - 1) / 2;
  for (std::size_t i = 0; i < z.size(); ++i) {
    const double d = static_cast<double>(i) - middle;
    mean += z[i];
    moment += d * z[i];
    spread += d * d;
  }
  mean /= static_cast<double>(z.size());
  const double slope = moment / spread;
  if (!std::isfinite(mean))
    return data_error(
        "the wall profile has points that no tooth has cut: choose an evaluation length inside the "
        "finished part");
  Roughness result;
  std::vector<double> residual(z.size());
  for (std::size_t i = 0; i < z.size(); ++i) {
    residual[i] = z[i] - mean - slope * (static_cast<double>(i) - middle);
    result.ra_m += std::abs(residual[i]) / static_cast<double>(z.size());
  }
  for (std::size_t k = 0; k < kSamplingLengths; ++k) {
    const auto from = static_cast<std::ptrdiff_t>(k * z.size() / kSamplingLengths);
    const auto to = static_cast<std::ptrdiff_t>((k + 1) * z.size() / kSamplingLengths);
    const auto [low, high] = std::minmax_element(residual.begin() + from, residual.begin() + to);
    result.rz_m += (*high - *low) / kSamplingLengths;
  }
  return result;
}

MachinedSurface::MachinedSurface(const Config& config)
    : radius_m_(config.tool.radius_m()),
      heights_(config.heights_m.size()),
      points_(std::max(config.points,
                       static_cast<std::size_t>(std::ceil(4 * radius_m_ / config.spacing_m)))) {
  const MillingTool& tool = config.tool;
  const auto teeth = static_cast<std::size_t>(tool.teeth);
  broken_to_m_.assign(teeth, 0.0);
  const double lag_per_m = std::tan(rad_from_deg(tool.helix_deg)) / radius_m_;
  for (const bool down : {false, true}) {
    if (config.direction == (down ? MillingDirection::up : MillingDirection::down)) continue;
    for (const double height : config.heights_m) {
      Wall wall;
      wall.side = down ? -1 : 1;
      wall.profile.spacing_m = config.spacing_m;
      wall.profile.first_x_m = config.start_x_m - radius_m_ * std::sin(kNear_rad);
      for (std::size_t i = 0; i < teeth; ++i) {
        const double ahead = tool.tooth_angle_rad.empty()
                                 ? kTwoPi * static_cast<double>(i) / static_cast<double>(teeth)
                                 : tool.tooth_angle_rad[i];
        Edge edge;
        edge.tooth = i;
        edge.reach_m = radius_m_ + (tool.throw_m.empty() ? 0.0 : tool.throw_m[i]);
        edge.height_m = height;
        edge.passes_rad = (down ? kPi : 0.0) + lag_per_m * height - ahead;
        wall.edges.push_back(edge);
      }
      walls_.push_back(std::move(wall));
    }
  }
}

void MachinedSurface::break_tooth(std::size_t tooth, double height_m) {
  broken_to_m_[tooth] = std::max(broken_to_m_[tooth], height_m);
}

void MachinedSurface::advance(double tip_angle_rad, double axis_x_m, double axis_y_m) {
  if (tip_angle_rad < next_visit_rad_) return;  // no edge is near a wall
  next_visit_rad_ = std::numeric_limits<double>::infinity();
  for (Wall& wall : walls_) {
    for (Edge& edge : wall.edges) {
      // Past the wall: on to the next turn. At the start the turn is found.
      const double late = tip_angle_rad - (edge.passes_rad + kNear_rad);
      if (late > 0 || late <= -kTwoPi) {
        edge.passes_rad += kTwoPi * std::ceil(late / kTwoPi);
        edge.near = false;
      }
      next_visit_rad_ = std::min(next_visit_rad_, edge.passes_rad - kNear_rad);
      const double off = tip_angle_rad - edge.passes_rad;
      if (off < -kNear_rad) continue;
      if (edge.height_m < broken_to_m_[edge.tooth])
        edge.near = false;
      else
        leave_mark(wall, edge, off, axis_x_m, axis_y_m);
    }
  }
}

// Lets the oldest points go; says how many.
std::size_t MachinedSurface::forget(WallProfile& profile, std::size_t points) {
  points = std::min(points, profile.height_m.size());
  profile.height_m.erase(profile.height_m.begin(),
                         profile.height_m.begin() + static_cast<std::ptrdiff_t>(points));
  profile.first_x_m += static_cast<double>(points) * profile.spacing_m;
  return points;
}

void MachinedSurface::leave_mark(Wall& wall, Edge& edge, double off_rad, double axis_x_m,
                                 double axis_y_m) {
  // At the wall of up milling the tooth moves along +x, at the other against it.
  const double x = axis_x_m + wall.side * edge.reach_m * small_sine(off_rad);
  const double z = radius_m_ - wall.side * axis_y_m - edge.reach_m * small_cosine(off_rad);
  if (edge.near && x != edge.x_m) {
    WallProfile& profile = wall.profile;
    const double low = std::min(x, edge.x_m), high = std::max(x, edge.x_m);
    const double slope = (z - edge.z_m) / (x - edge.x_m);
    // Between two positions the tip is on its arc, which hangs below the chord.
    const double sag_per_m = 0.5 / edge.reach_m;
    const double lowest = std::min(z, edge.z_m) - sag_per_m / 4 * (high - low) * (high - low);
    const auto place = [&](std::size_t k) {
      return profile.first_x_m + static_cast<double>(k) * profile.spacing_m;
    };
    auto k = static_cast<std::size_t>(std::max((low - profile.first_x_m) / profile.spacing_m, 0.0));
    if (place(k) < low) ++k;
    for (double at = place(k); at <= high; at = place(++k)) {
      if (k >= profile.height_m.size()) {
        if (k >= points_) k -= forget(profile, points_ / 2);
        profile.height_m.resize(k + 1, kNever);
      }
      double& height = profile.height_m[k];
      if (height <= lowest) continue;  // most of the way to and from the wall
      const double left = z + slope * (at - x) - (at - low) * (high - at) * sag_per_m;
      if (!(height <= left)) height = left;
    }
  }
  edge.near = true;
  edge.x_m = x;
  edge.z_m = z;
}

const WallProfile& MachinedSurface::wall(std::size_t i, MillingDirection side) const {
  const bool both = walls_.size() > heights_;
  return walls_[i + (both && side == MillingDirection::down ? heights_ : 0)].profile;
}

}  // namespace servosense
