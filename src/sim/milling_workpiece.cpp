#include <algorithm>
#include <cmath>
#include <string>

#include "servosense/sim/workpiece.hpp"

namespace servosense {
namespace {

/// Takes the open arc (from, to), seen at every turn, out of the set.
void remove(std::vector<Engagement>& arcs, double from, double to) {
  if (!(from < to)) return;
  for (int turn = -1; turn <= 1; ++turn) {
    const double a = from + turn * kTwoPi;
    const double b = to + turn * kTwoPi;
    std::vector<Engagement> left;
    for (const Engagement& arc : arcs) {
      if (b <= arc.start_rad || a >= arc.exit_rad) {
        left.push_back(arc);
        continue;
      }
      if (a > arc.start_rad) left.push_back({arc.start_rad, a});
      if (b < arc.exit_rad) left.push_back({b, arc.exit_rad});
    }
    arcs = std::move(left);
  }
}

/// Takes out the angles whose sine lies between `low` and `high`.
void remove_sines(std::vector<Engagement>& arcs, double low, double high) {
  if (high <= -1 || low >= 1) return;
  const double a = low <= -1 ? -kPi / 2 : std::asin(low);
  const double b = high >= 1 ? kPi / 2 : std::asin(high);
  remove(arcs, a, b);
  remove(arcs, kPi - b, kPi - a);
}

}  // namespace

Expected<Done> validate(const Workpiece& workpiece) {
  if (!(workpiece.length_m > 0))
    return usage_error("the workpiece has no length: give a length above zero");
  if (!(workpiece.front_depth_m >= 0) || !(workpiece.far_depth_m >= 0))
    return usage_error("a depth of the wedge-shaped workpiece is negative: give both from zero up");
  if (workpiece.is_wedge() && !std::isfinite(workpiece.length_m))
    return usage_error("the wedge-shaped workpiece has no length: its depths need one");
  for (const WorkpieceSlot& slot : workpiece.slots)
    if (!(slot.from_m < slot.to_m))
      return usage_error("a slot in the workpiece ends before it begins: give from < to");
  for (const WorkpieceHole& hole : workpiece.holes)
    if (!(hole.radius_m > 0) || !std::isfinite(hole.x_m) || !std::isfinite(hole.y_m))
      return usage_error("a hole in the workpiece needs a radius above zero and a finite centre");
  return Done{};
}

std::vector<Engagement> engagement_arcs(const Workpiece& workpiece, double radius_m,
                                        const Engagement& within, double axis_x_m) {
  constexpr double kOutside = 2;  // beyond any sine
  std::vector<Engagement> arcs{within};
  remove_sines(arcs, -kOutside, -axis_x_m / radius_m);
  remove_sines(arcs, (workpiece.length_m - axis_x_m) / radius_m, kOutside);
  for (const WorkpieceSlot& slot : workpiece.slots)
    remove_sines(arcs, (slot.from_m - axis_x_m) / radius_m, (slot.to_m - axis_x_m) / radius_m);
  for (const WorkpieceHole& hole : workpiece.holes) {
    const double dx = hole.x_m - axis_x_m;
    const double distance = std::hypot(dx, hole.y_m);
    if (distance + radius_m < hole.radius_m) return {};
    if (distance == 0) continue;
    const double cosine =
        (distance * distance + radius_m * radius_m - hole.radius_m * hole.radius_m) /
        (2 * distance * radius_m);
    if (cosine >= 1 || cosine <= -1) continue;
    const double towards = std::atan2(dx, hole.y_m);
    const double half = std::acos(cosine);
    remove(arcs, towards - half, towards + half);
  }
  return arcs;
}

double first_contact_m(double radius_m, const Engagement& within) {
  const bool reaches_front = within.start_rad <= kPi / 2 && within.exit_rad >= kPi / 2;
  return -radius_m *
         (reaches_front ? 1.0 : std::max(std::sin(within.start_rad), std::sin(within.exit_rad)));
}

}  // namespace servosense
