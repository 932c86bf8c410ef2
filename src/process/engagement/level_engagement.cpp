// What the lines along x and y say of a step: where the cutter's circles lie in the part.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "servosense/process/engagement/program_engagement.hpp"
#include "step_length.hpp"

namespace servosense::process {
namespace {

/// Least and greatest sine on an arc.
std::array<double, 2> sines(const Arc& arc) {
  constexpr double to_rad = std::numbers::pi / 180;
  const double a = std::sin(arc.from_deg * to_rad), b = std::sin(arc.to_deg * to_rad);
  double low = std::min(a, b), high = std::max(a, b);
  if (arc.from_deg <= 90 && arc.to_deg >= 90) high = 1;
  if (arc.from_deg <= 270 && arc.to_deg >= 270) low = -1;
  return {low, high};
}

/// What an arc of a circle covers across the feed, to the left positive; as an Arc, in metres.
Arc lateral(const Arc& arc, double radius) {
  constexpr double to_rad = std::numbers::pi / 180;
  const double a = std::cos(arc.from_deg * to_rad), b = std::cos(arc.to_deg * to_rad);
  double low = std::min(a, b), high = std::max(a, b);
  if (arc.from_deg <= 0 && arc.to_deg >= 0) high = 1;
  if (arc.from_deg <= 180 && arc.to_deg >= 180) low = -1;
  return {radius * low, radius * high};
}

/// Of a point, from the line that a step goes on.
double off_line(const Point& at, const Point& from, const Point& to) {
  Point d{}, m{};
  for (std::size_t i = 0; i < 3; ++i) d[i] = at[i] - from[i], m[i] = to[i] - from[i];
  return std::hypot(d[1] * m[2] - d[2] * m[1], d[2] * m[0] - d[0] * m[2],
                    d[0] * m[1] - d[1] * m[0]) /
         length_of(from, to);
}

/// How far behind the middle of a step what has been cleared is out of the way of its circle: where
/// the circle begins at the side of the feed, the nearest of it is then four line spacings off, of
/// which one holds the end of an arc and two more say whether the outline has a corner there.
double free_behind(double radius, double spacing) { return std::sqrt(8 * radius * spacing); }

}  // namespace

void ProgramEngagement::clear(const Held& held) {
  // A layer of margin: the lines along z do not stand everywhere.
  workpiece_.remove_level(Sweep(*held.cutter, held.from, held.to),
                          held.top_z + workpiece_.cell_m()[2]);
}

void ProgramEngagement::clear_held() {
  for (const Held& held : held_) clear(held);
  held_.clear();
  held_m_ = 0;
}

/// How what the cutter has cleared on the way from `held.from` to `held.to` meets its front.
ProgramEngagement::Meeting ProgramEngagement::meeting(const Step& step, const Held& held) {
  if (held.cutter != step.cutter) return Meeting::unknown;
  // A convex body that goes straight on lies behind the planes that touch its front.
  const auto behind = [&](const Point& at) {
    double sum = 0;
    for (std::size_t i = 0; i < 3; ++i) sum += (step.to[i] - step.from[i]) * (at[i] - step.from[i]);
    return sum <= 0 && off_line(at, step.from, step.to) < kContactDepth / 2;
  };
  if (behind(held.from) && behind(held.to)) return Meeting::none;
  return Meeting::circles;
}

void ProgramEngagement::cut_level(std::vector<Step>& steps) {
  if (!workpiece_.has_level_lines()) return;
  const double spacing = std::max(workpiece_.cell_m()[0], workpiece_.cell_m()[1]);
  for (Step& step : steps) {
    if (step.air) continue;
    for (Held& held : held_) held.meeting = meeting(step, held);
    if (std::ranges::any_of(held_, [](const Held& h) { return h.meeting == Meeting::unknown; }))
      clear_held();
    if (step.low_z < step.high_z) look_at(step);
    held_.push_back({step.cutter, step.from, step.to, step.top_z, Meeting::none});
    held_m_ += length_of(step.from, step.to);
    const double enough = free_behind(step.cutter->radius_m(), spacing);
    while (held_m_ - length_of(held_.front().from, held_.front().to) > enough) {
      held_m_ -= length_of(held_.front().from, held_.front().to);
      clear(held_.front());
      held_.pop_front();
    }
  }
}

/// Of the circle of `radius` at height `z`: what the cutter has cleared in that layer.
void ProgramEngagement::take_out(const Held& held, double z, double radius,
                                 std::vector<Arc>& arcs) const {
  const Cutter& cutter = *held.cutter;
  const bool level = held.from[2] == held.to[2];
  if (!cutter.is_cylinder() && !(level && cutter.radius_at(z - held.from[2]) == radius)) {
    // Circles of other radii. The union of such that are so far apart is off by an eighth of what
    // counts.
    const double apart = std::sqrt(8 * radius * kContactDepth / 8);
    const double length = length_of(held.from, held.to);
    const auto count = static_cast<std::size_t>(std::ceil(length / apart)) + 1;
    std::vector<EngagedArcs::Disc> way;
    for (std::size_t i = 0; i <= count; ++i) {
      const double share = static_cast<double>(i) / static_cast<double>(count);
      const auto at = [&](std::size_t k) {
        return held.from[k] + share * (held.to[k] - held.from[k]);
      };
      way.push_back({at(0), at(1), cutter.radius_at(z - at(2))});
    }
    circle_.take_out(way, arcs);
    return;
  }
  const double highest_tip = z - cutter.bottom_m();
  double low = 0, high = 1;  // of the way, where the cutter reaches down to the layer
  const double from = highest_tip - held.from[2], to = highest_tip - held.to[2];
  if (from < 0 && to < 0) return;
  if (from < 0) low = from / (from - to);
  if (to < 0) high = from / (from - to);
  const auto at = [&](double share) {
    return std::array{held.from[0] + share * (held.to[0] - held.from[0]),
                      held.from[1] + share * (held.to[1] - held.from[1])};
  };
  circle_.take_out(at(low), at(high), arcs);
}

void ProgramEngagement::look_at(Step& step) {
  Engagement& e = step.engagement;
  const Cutter& cutter = *step.cutter;
  const double tip = step.middle[2], layer = workpiece_.cell_m()[2];
  const double low = std::max(step.low_z, tip + cutter.bottom_m()), high = step.high_z;
  double least = 2, greatest = -1;
  if (e.bottom_m2 > 0) least = greatest = -step.rise;
  std::vector<Arc> found, across;
  if (high > low) {
    const auto layers = workpiece_.lattice_range(2, {low, high});
    const std::size_t count = layers[1] - layers[0];
    const std::size_t slabs = std::clamp(count, std::size_t{1}, kMostSlabs);
    e.thin = count == 0;
    if (e.thin && !step.in_core) return;  // no line says that it is thicker than nothing
    double set_radius = -1, set_sine = 0;
    for (std::size_t s = 0; s < slabs; ++s) {
      const auto edge = [&](std::size_t at) {
        return low + (high - low) * static_cast<double>(at) / static_cast<double>(slabs);
      };
      double z = (edge(s) + edge(s + 1)) / 2;
      std::size_t k = 0;
      if (!e.thin) {
        const double place = std::round((z - workpiece_.origin()[2]) / layer - 0.5);
        k = static_cast<std::size_t>(
            std::clamp(place, static_cast<double>(layers[0]), static_cast<double>(layers[1]) - 1));
        z = workpiece_.lattice(2, k);
      }
      const double radius = cutter.radius_at(z - tip);
      if (!(radius > 0)) continue;
      // Faces the path: level sin(angle) - rise widening > 0.
      const double widening = cutter.widening_at(z - tip);
      double sine = 0;
      if (step.level > 0)
        sine = widening > 0 ? step.rise * widening / step.level : 0;
      else
        sine = step.rise < 0 && widening > 0 ? -2 : 2;
      if (sine >= 1) continue;
      std::vector<Arc> arcs;
      if (e.thin) {
        const auto angle = [&](double aside) {
          return std::acos(std::clamp(aside / radius, -1.0, 1.0)) * 180 / std::numbers::pi;
        };
        arcs = step.level > 0 ? std::vector<Arc>{{angle(step.left), angle(step.right)}}
                              : std::vector<Arc>{{0, 360}};
      } else {
        if (radius != set_radius || sine != set_sine)
          circle_.set_circle(step.middle[0], step.middle[1], radius, step.ahead, sine);
        set_radius = radius, set_sine = sine;
        circle_.find(k, arcs);
        for (const Held& held : held_)
          if (held.meeting == Meeting::circles) take_out(held, z, radius, arcs);
      }
      const double area = cutter.side_area_per_rad(edge(s) - tip, edge(s + 1) - tip);
      const double across_m = 1 / std::sqrt(1 + widening * widening);
      for (const Arc& arc : arcs) {
        e.side_m2 += area * (arc.to_deg - arc.from_deg) * std::numbers::pi / 180;
        found.push_back(arc);
        e.side.push_back({arc, edge(s) - tip, edge(s + 1) - tip, radius, widening});
        across.push_back(lateral(arc, radius));
        for (const double sin_angle : sines(arc)) {
          const double chip = (step.level * sin_angle - step.rise * widening) * across_m;
          least = std::min(least, std::max(0.0, chip)), greatest = std::max(greatest, chip);
        }
      }
    }
  }
  if (!step.in_core && !e.side.empty())
    e.axial_depth_m = e.side.back().high_m - e.side.front().low_m;
  unite(found, 0.25);
  unite(across, layer);
  e.arcs = std::move(found);
  for (const Arc& part : across) e.radial_immersion_m += part.to_deg - part.from_deg;
  if (greatest >= 0) e.least_chip = least, e.greatest_chip = greatest;
}

}  // namespace servosense::process
