#include "servosense/process/optimise/feed_limits.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

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

/// Of a revolution a minute.
constexpr double kRadPerSecond = std::numbers::pi / 30;

/// A chip that is thicker than this is none, where nothing else bounds it (chosen).
constexpr double kThickestChip = 5e-3;

}  // namespace

std::string_view bound_name(FeedBound bound) {
  static constexpr std::array<std::string_view, 9> names = {
      "none", "torque",     "power",        "feed-per-tooth", "deflection",
      "feed", "axis-speed", "acceleration", "fixed"};
  return names[static_cast<std::size_t>(bound)];
}

TorqueOverSpeed TorqueOverSpeed::from(const MachineFile& machine) {
  constexpr const char* section = "effect.spindle.field-weakening";
  TorqueOverSpeed t;
  if (auto table = machine.pairs(section, "current_per_torque"); table && table->size() > 1) {
    t.current_per_torque = std::move(*table);
    t.base_rad_s = t.current_per_torque.front()[0];
  } else if (const auto base = machine.number(section, "base_speed_rad_s")) {
    t.base_rad_s = *base;
    t.exponent = machine.number(section, "exponent").value_or(1);
  }
  return t;
}

double TorqueOverSpeed::share(double speed_rad_s) const {
  if (!(speed_rad_s > base_rad_s)) return 1;
  if (current_per_torque.empty()) return std::pow(base_rad_s / speed_rad_s, exponent);
  std::size_t k = 1;
  while (k + 1 < current_per_torque.size() && speed_rad_s > current_per_torque[k][0]) ++k;
  const auto& a = current_per_torque[k - 1];
  const auto& b = current_per_torque[k];
  return 1 / std::max(1.0, a[1] + (b[1] - a[1]) * (speed_rad_s - a[0]) / (b[0] - a[0]));
}

CutLimits CutLimits::from(const MachineFile& machine) {
  const auto limit = [&](const char* key) { return machine.number("limits", key).value_or(kNone); };
  CutLimits limits{limit("torque_Nm"),    limit("power_W"),  limit("feed_per_tooth_m"),
                   limit("deflection_m"), limit("feed_m_s"), TorqueOverSpeed::from(machine)};
  if (std::isinf(limits.power_W))
    limits.power_W = machine.number("spindle", "rated_power_W").value_or(kNone);
  return limits;
}

double CutLimits::torque_at(double spindle_rpm) const {
  return torque_Nm * over_speed.share(std::abs(spindle_rpm) * kRadPerSecond);
}

double CutLimits::torque_of_power(double spindle_rpm) const {
  return power_W / (std::abs(spindle_rpm) * kRadPerSecond);
}

bool CutLimits::bound_a_cut() const {
  return torque_Nm < kNone || power_W < kNone || feed_per_tooth_m < kNone || deflection_m < kNone;
}

double axis_speed(const CanonicalMove& move, const AxisPoint& from, const MotionLimits& motion) {
  if (move.kind == CanonicalMove::Kind::arc) {
    double least = kNoLimit;
    const auto axes = plane_axes(move.plane);
    for (std::size_t i = 0; i < 2; ++i) least = std::min(least, motion.velocity_m_s[axes[i]]);
    return least;
  }
  double length = 0;
  for (std::size_t i = 0; i < 3; ++i) length = std::hypot(length, move.machine[i] - from[i]);
  double speed = kNoLimit;
  for (std::size_t i = 0; i < 3; ++i)
    if (const double way = std::abs(move.machine[i] - from[i]); way > 0)
      speed = std::min(speed, motion.velocity_m_s[i] * length / way);
  return speed;
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
    add(limits.torque_at(spindle_rpm), FeedBound::torque);
    add(limits.torque_of_power(spindle_rpm), FeedBound::power);
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
