#include "chatter_advice.hpp"

#include <cmath>
#include <cstdio>

#include "servosense/identify/chatter_frequency.hpp"

namespace servosense::cli {
namespace {

std::string whole(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f", value);
  return text;
}

}  // namespace

ChatterAdvice::ChatterAdvice(const MachineFile& machine, const StackPlan& plan)
    : chatter_(plan.config.spindle.chatter), observer_(plan.config.spindle.monitor_observer) {
  if (const auto teeth = machine.number("tool", "teeth")) teeth_ = static_cast<unsigned>(*teeth);
  for (const char* section : {"structure.x", "structure.y"})
    if (const auto modes = machine.triples(section, "modes"))
      for (const auto& mode : *modes) natural_hz_.push_back(mode[0]);
}

std::string ChatterAdvice::clause(const HostStack& stack) const {
  std::vector<HostStack::Chatter::Sample> samples(stack.chatter().evidence().count);
  if (samples.empty() || stack.chatter().copy_evidence(samples) != samples.size()) return {};
  std::vector<double> torque_Nm, angle_rad;
  for (const auto& sample : samples) {
    torque_Nm.push_back(sample.torque_Nm);
    angle_rad.push_back(sample.angle_rad);
  }
  ChatterLineConfig config;
  config.sample_period_s = chatter_.sample_period_s;
  config.harmonics = chatter_.harmonics;
  config.teeth = teeth_;
  config.disturbance_cutoff_rad_s = observer_.disturbance_cutoff_rad_s;
  config.velocity_cutoff_rad_s = observer_.velocity_cutoff_rad_s;
  config.natural_frequencies_hz = natural_hz_;
  const auto line = chatter_line(torque_Nm, angle_rad, config);
  // Less than a tenth of the power in one line is noise, not a swinging tool.
  if (!line || line->share < 0.1) return {};
  std::string clause = "; it swings at " + whole(line->frequency_hz) + " Hz";
  if (teeth_ == 0) return clause;
  // The nearest quiet speed on either side.
  std::string speeds;
  double below = 0, above = 0;
  for (const double rpm :
       quiet_speeds_rpm(line->frequency_hz, teeth_, 0.5 * line->spindle_speed_rpm,
                        2 * line->spindle_speed_rpm)) {
    if (rpm <= line->spindle_speed_rpm) below = rpm;
    if (rpm > line->spindle_speed_rpm && above == 0) above = rpm;
  }
  if (below > 0) speeds = whole(below);
  if (above > 0) speeds += (speeds.empty() ? "" : " or ") + whole(above);
  return speeds.empty() ? clause : clause + "; try " + speeds + " rpm";
}

}  // namespace servosense::cli
