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
// Conventions, those of the verdict: a standing spindle swings by less, and a tenth is left out.
constexpr double kTurning_rad_s = 1;
constexpr double kMostSlow = 0.1;

std::string rpm(double rad_s) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g rpm", rpm_from_rad_s(rad_s));
  return text;
}

}  // namespace

KnownTorque::KnownTorque(const StackPlan& plan, const SampleSource& source)
    : period_s_(source.sample_period_s()) {
  spindles_[1].channel = Channel::spindle2;
  for (Spindle& s : spindles_) {
    if (plan.slot_of(s.channel) != nullptr) s.known_to_rad_s = plan.known_to_rad_s(s.channel);
    if (const auto& columns = source.drive(s.channel); columns && columns->power)
      s.known_from_rad_s = columns->power->known_from_rad_s;
    s.speed.configure(
        {std::min(1 / kSmooth_s, 0.5 / period_s_), period_s_, Discretisation::tustin});
  }
}

void KnownTorque::sample(const MachineStack& stack, bool recorded) {
  for (Spindle& s : spindles_) {
    if (!(s.known_to_rad_s > 0) && !(s.known_from_rad_s > 0)) continue;
    const double speed =
        std::abs(s.speed.process(stack.drive(s.channel).sample.increment / period_s_));
    const bool fast = s.known_to_rad_s > 0 && speed > kMargin * s.known_to_rad_s;
    const bool slow = speed < s.known_from_rad_s;
    s.known = !fast && !slow;
    if (!recorded) continue;
    if (s.known_from_rad_s > 0 && speed > kTurning_rad_s) {
      ++s.turning;
      if (slow) ++s.slow;
    }
    if (!fast) continue;
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
    char seconds[32];
    const auto time = [&](std::uint64_t samples) {
      std::snprintf(seconds, sizeof seconds, "%.3g s", static_cast<double>(samples) * period_s_);
      return std::string(seconds);
    };
    if (s.beyond > 0) {
      const std::string known = "torque per ampere is known to " + rpm(s.known_to_rad_s);
      const std::string sentence = known + ", for " + time(s.beyond) +
                                   " the spindle turned faster, up to " + rpm(s.fastest_rad_s);
      plan.remarks.push_back(std::string(name_of(s.channel)) + ": " + sentence +
                             ": no torque is given there; record an idling run with run-ups to "
                             "that speed for 'servosense identify idle'");
      tell(s, known + " only", sentence, plan, watched);
    }
    if (!(s.known_from_rad_s > 0)) continue;
    const std::string known = "power tells the torque from " + rpm(s.known_from_rad_s) + " on";
    const std::string sentence = s.slow == 0 ? known
                                             : known + ", for " + time(s.slow) + " of " +
                                                   time(s.turning) + " the spindle turned slower";
    plan.remarks.push_back(std::string(name_of(s.channel)) + ": " + sentence +
                           ": no torque is given there, nor at rest");
    if (static_cast<double>(s.slow) > kMostSlow * static_cast<double>(s.turning))
      tell(s, known + " only", sentence, plan, watched);
  }
}

void KnownTorque::tell(const Spindle& s, const std::string& known, const std::string& sentence,
                       StackPlan& plan, std::vector<Watched>& watched) const {
  for (std::size_t i = 0; i < plan.monitors.size() && i < watched.size(); ++i) {
    MonitorAvailability& m = plan.monitors[i];
    const bool hears =
        m.channel == s.channel || (s.channel == plan.tool_spindle && m.channel == Channel::tool);
    if (!m.runs || m.monitor == MonitorId::signal || !hears) continue;
    m.reason += (m.reason.empty() ? "" : "; ") + sentence;
    if (watched[i].why.empty()) watched[i].why = known;
  }
}

}  // namespace servosense::cli
