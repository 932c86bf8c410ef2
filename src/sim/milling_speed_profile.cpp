#include <algorithm>
#include <cmath>

#include "servosense/sim/spindle_speed_profile.hpp"

namespace servosense {

SpindleSpeedProfile SpindleSpeedProfile::ramp(double from_rpm, double to_rpm, double percent_per_s,
                                              double base_rpm) {
  const double rate_rpm_per_s = std::abs(percent_per_s) / 100 * base_rpm;
  return {{{0.0, from_rpm}, {std::abs(to_rpm - from_rpm) / rate_rpm_per_s, to_rpm}}};
}

double SpindleSpeedProfile::speed_rpm(double time_s) const {
  const auto after = std::upper_bound(points.begin(), points.end(), time_s,
                                      [](double t, const Point& p) { return t < p.time_s; });
  if (after == points.begin()) return points.front().speed_rpm;
  const Point& before = *(after - 1);
  if (after == points.end()) return before.speed_rpm;
  const double share = (time_s - before.time_s) / (after->time_s - before.time_s);
  return before.speed_rpm + share * (after->speed_rpm - before.speed_rpm);
}

Expected<Done> SpindleSpeedProfile::validate() const {
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!(points[i].speed_rpm > 0) || !std::isfinite(points[i].speed_rpm))
      return usage_error("the spindle speed profile holds a speed that is not above zero");
    if (!std::isfinite(points[i].time_s) || (i > 0 && !(points[i - 1].time_s < points[i].time_s)))
      return usage_error(
          "the times of the spindle speed profile do not ascend (a ramp rate of zero does this "
          "too): give points in order of time");
  }
  return Done{};
}

}  // namespace servosense
