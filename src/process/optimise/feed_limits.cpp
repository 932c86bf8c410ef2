#include "servosense/process/optimise/feed_limits.hpp"

#include <array>
#include <cmath>
#include <numbers>

#include "servosense/process/torque/step_load.hpp"

namespace servosense::process {
namespace {

/// Feed per tooth at which the tool bends by `limit_m`; at most `upto_m`. Deflection rises with
/// the feed, nearly in proportion.
double feed_for_deflection(const Engagement& e, const ToolLaw& law, StepConditions conditions,
                           double limit_m, double upto_m) {
  const auto bends = [&](double feed_m) {
    conditions.feed_per_tooth_m = feed_m;
    const auto d = step_load(e, law, conditions).deflection_m;
    return std::hypot(d[0], d[1]);
  };
  if (bends(upto_m) <= limit_m) return upto_m;
  double low = 0, high = upto_m;
  constexpr int halvings = 20;
  for (int i = 0; i < halvings; ++i) {
    const double middle = (low + high) / 2;
    (bends(middle) <= limit_m ? low : high) = middle;
  }
  return low;
}

/// A chip that is thicker than this is none, where nothing else bounds it (chosen).
constexpr double kThickestChip = 5e-3;

}  // namespace

std::string_view bound_name(FeedBound bound) {
  static constexpr std::array<std::string_view, 9> names = {
      "none", "torque",     "power",        "feed-per-tooth", "deflection",
      "feed", "axis-speed", "acceleration", "fixed"};
  return names[static_cast<std::size_t>(bound)];
}

CutLimits CutLimits::from(const MachineFile& machine) {
  const auto limit = [&](const char* key) { return machine.number("limits", key).value_or(kNone); };
  return {limit("torque_Nm"), limit("power_W"), limit("feed_per_tooth_m"), limit("deflection_m"),
          limit("feed_m_s")};
}

bool CutLimits::bound_a_cut() const {
  return torque_Nm < kNone || power_W < kNone || feed_per_tooth_m < kNone || deflection_m < kNone;
}

BoundFeed bound_feed(const Engagement& e, const ToolLaw& law, double spindle_rpm,
                     const std::array<double, 2>& compliance, const CutLimits& limits) {
  const double turns_s = std::abs(spindle_rpm) / 60, teeth_s = law.teeth * turns_s;
  BoundFeed found;
  found.add(limits.feed_per_tooth_m * teeth_s, FeedBound::feed_per_tooth);
  if (law.torque) {
    const StepAreas areas = step_areas(e);
    const auto add = [&](double torque_Nm, FeedBound by) {
      if (std::isinf(torque_Nm)) return;
      found.add(law.torque->feed_m(torque_Nm, areas.removed_m2, areas.contact_m2) * teeth_s, by);
    };
    add(limits.torque_Nm, FeedBound::torque);
    add(limits.power_W / (2 * std::numbers::pi * turns_s), FeedBound::power);
  }
  if (limits.deflection_m < CutLimits::kNone && found.feed_m_s > 0) {
    const double upto_m = std::min(found.feed_m_s / teeth_s, kThickestChip);
    const double feed_m =
        feed_for_deflection(e, law, {0, spindle_rpm, 0, compliance}, limits.deflection_m, upto_m);
    if (feed_m < upto_m) found.add(feed_m * teeth_s, FeedBound::deflection);
  }
  return found;
}

}  // namespace servosense::process
