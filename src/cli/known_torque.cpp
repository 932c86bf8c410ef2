#include "known_torque.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "console.hpp"
#include "servosense/core/units.hpp"

namespace servosense::cli {
namespace {

// At constant power torque is off by as much as the speed is beyond: 5 % is within the error of a
// torque constant.
constexpr double kMargin = 1.05;
constexpr double kSmooth_s = 0.02;

std::string rpm(double rad_s) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g rpm", rpm_from_rad_s(rad_s));
  return text;
}

}  // namespace

KnownTorque::KnownTorque(const StackPlan& plan, double sample_period_s)
    : period_s_(sample_period_s), known_to_rad_s_(plan.torque_constant_known_to_rad_s) {
  limit_rad_s_ = kMargin * known_to_rad_s_;
  speed_.configure(
      {std::min(1 / kSmooth_s, 0.5 / sample_period_s), sample_period_s, Discretisation::tustin});
}

bool KnownTorque::sample(double increment_rad, bool recorded) {
  if (!(limit_rad_s_ > 0)) return known_;
  const double speed = std::abs(speed_.process(increment_rad / period_s_));
  known_ = !(speed > limit_rad_s_);
  if (known_ || !recorded) return known_;
  ++beyond_;
  fastest_rad_s_ = std::max(fastest_rad_s_, speed);
  return known_;
}

void KnownTorque::tell(StackPlan& plan, std::vector<Watched>& watched) const {
  if (beyond_ == 0) return;
  char seconds[32];
  std::snprintf(seconds, sizeof seconds, "%.3g s", static_cast<double>(beyond_) * period_s_);
  const std::string sentence = "torque per ampere is known to " + rpm(known_to_rad_s_) + ", for " +
                               seconds + " the spindle turned faster, up to " + rpm(fastest_rad_s_);
  plan.remarks.push_back("spindle: " + sentence +
                         ": no torque is given there; record an idling run with run-ups to that "
                         "speed for 'servosense identify idle'");
  for (std::size_t i = 0; i < plan.monitors.size() && i < watched.size(); ++i) {
    MonitorAvailability& m = plan.monitors[i];
    if (!m.runs || m.monitor == MonitorId::signal ||
        (m.channel != Channel::spindle && m.channel != Channel::tool))
      continue;
    m.reason += (m.reason.empty() ? "" : "; ") + sentence;
    if (watched[i].why.empty())
      watched[i].why = "torque known to " + rpm(known_to_rad_s_) + " only";
  }
}

}  // namespace servosense::cli
