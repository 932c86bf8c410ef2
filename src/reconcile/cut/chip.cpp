#include "reconcile/cut/chip.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/core/units.hpp"

namespace servosense::reconcile {

double pitch_angle(const MillingTool& tool, std::size_t tooth) {
  return tool.tooth_angle_rad.empty()
             ? kTwoPi * static_cast<double>(tooth) / static_cast<double>(tool.teeth)
             : tool.tooth_angle_rad[tooth];
}

double total_lag(const CutState& state) {
  return state.lag_scale * state.cut.axial_depth_m * std::tan(rad_from_deg(state.tool.helix_deg)) /
         state.tool.radius_m();
}

std::vector<Zone> zones_of(const MillingTool& tool) {
  std::vector<double> ends = {0, 1};
  for (const double f : tool.broken_fraction) ends.push_back(std::clamp(f, 0.0, 1.0));
  std::sort(ends.begin(), ends.end());
  std::vector<Zone> zones;
  for (std::size_t i = 0; i + 1 < ends.size(); ++i) {
    if (!(ends[i + 1] > ends[i])) continue;
    Zone zone{ends[i], ends[i + 1], {}};
    for (std::size_t j = 0; j < static_cast<std::size_t>(tool.teeth); ++j)
      if (tool.broken_fraction.empty() || tool.broken_fraction[j] <= ends[i])
        zone.teeth.push_back(j);
    zones.push_back(std::move(zone));
  }
  return zones;
}

std::vector<double> breaks_of(const CutState& state) {
  std::vector<double> breaks;
  const Engagement arc = engagement_of(state);
  const double lag = total_lag(state);
  for (const Zone& zone : zones_of(state.tool))
    for (const std::size_t tooth : zone.teeth)
      for (const double end : {arc.start_rad, arc.exit_rad})
        for (const double height : {zone.low, zone.high})
          for (const double half : {-0.5, 0.5})
            breaks.push_back(end + lag * height + half * state.blur_rad -
                             pitch_angle(state.tool, tooth) - state.zero_rad);
  return breaks;
}

ArcPoints::ArcPoints(const Engagement& arc)
    : start_rad(arc.start_rad),
      step_rad(arc.swept_rad() / static_cast<double>(kSteps)),
      sine(kSteps + 1),
      cosine(kSteps + 1) {
  for (Eigen::Index k = 0; k <= kSteps; ++k) {
    const double theta = start_rad + static_cast<double>(k) * step_rad;
    sine(k) = std::sin(theta);
    cosine(k) = std::cos(theta);
  }
}

Eigen::ArrayXd room_m(const CutState& state, const Zone& zone, std::size_t tooth,
                      double feed_per_tooth_m, const ArcPoints& arc) {
  const MillingTool& tool = state.tool;
  const double curvature_per_m = state.circular_paths ? 0 : 1 / tool.radius_m();
  const double feed_per_rad_m = feed_per_tooth_m * tool.teeth / kTwoPi;
  const auto thrown = [&](std::size_t j) { return tool.throw_m.empty() ? 0 : tool.throw_m[j]; };
  const double own = pitch_angle(tool, tooth);
  Eigen::ArrayXd least =
      Eigen::ArrayXd::Constant(ArcPoints::kSteps + 1, zone.teeth.empty() ? 0 : 1e9);
  // Two turns back: a tooth that reaches less than that never cuts.
  for (const std::size_t other : zone.teeth)
    for (int turn = 0; turn < 2; ++turn) {
      double ahead = pitch_angle(tool, other) - own;
      ahead -= kTwoPi * std::floor(ahead / kTwoPi);
      if (other == tooth) ahead = kTwoPi;
      const double since_m = feed_per_rad_m * (ahead + kTwoPi * turn);
      const double reach_m = thrown(tooth) - thrown(other);
      least = least.min(since_m * arc.sine + reach_m +
                        since_m * curvature_per_m * arc.cosine *
                            (0.5 * since_m * arc.cosine - feed_per_rad_m * arc.sine));
    }
  return least;
}

}  // namespace servosense::reconcile
