#include "known_torque.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

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
    : period_s_(sample_period_s) {
  spindles_[1].channel = Channel::spindle2;
  for (Spindle& s : spindles_) {
    if (plan.slot_of(s.channel) != nullptr) s.known_to_rad_s = plan.known_to_rad_s(s.channel);
    s.speed.configure(
        {std::min(1 / kSmooth_s, 0.5 / sample_period_s), sample_period_s, Discretisation::tustin});
  }
}

void KnownTorque::sample(const MachineStack& stack, bool recorded) {
  for (Spindle& s : spindles_) {
    if (!(s.known_to_rad_s > 0)) continue;
    const double speed =
        std::abs(s.speed.process(stack.drive(s.channel).sample.increment / period_s_));
    s.known = !(speed > kMargin * s.known_to_rad_s);
    if (s.known || !recorded) continue;
    ++s.beyond;
    s.fastest_rad_s = std::max(s.fastest_rad_s, speed);
  }
}

bool KnownTorque::known(Channel drive) const {
  for (const Spindle& s : spindles_)
    if (s.channel == drive) return s.known;
  return true;
}

void KnownTorque::tell(StackPlan& plan, std::vector<Watched>& watched) const {
  for (const Spindle& s : spindles_) {
    if (s.beyond == 0) continue;
    char seconds[32];
    std::snprintf(seconds, sizeof seconds, "%.3g s", static_cast<double>(s.beyond) * period_s_);
    const std::string known = "torque per ampere is known to " + rpm(s.known_to_rad_s);
    const std::string sentence =
        known + ", for " + seconds + " the spindle turned faster, up to " + rpm(s.fastest_rad_s);
    plan.remarks.push_back(std::string(name_of(s.channel)) + ": " + sentence +
                           ": no torque is given there; record an idling run with run-ups to "
                           "that speed for 'servosense identify idle'");
    for (std::size_t i = 0; i < plan.monitors.size() && i < watched.size(); ++i) {
      MonitorAvailability& m = plan.monitors[i];
      const bool hears =
          m.channel == s.channel || (s.channel == Channel::spindle && m.channel == Channel::tool);
      if (!m.runs || m.monitor == MonitorId::signal || !hears) continue;
      m.reason += (m.reason.empty() ? "" : "; ") + sentence;
      if (watched[i].why.empty()) watched[i].why = known + " only";
    }
  }
}

}  // namespace servosense::cli
