#include "chatter_advice.hpp"

#include <cmath>
#include <cstdio>

#include "servosense/core/units.hpp"
#include "servosense/identify/semi_discretization.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::cli {
namespace {

constexpr double kTurns = 16, kFewestTurns = 8, kLeast_s = 0.25;
constexpr std::size_t kMost = 4096;  // samples, where that is eight revolutions
constexpr double kPresent = 0.02;    // of the present speed, where nothing is advised

std::string whole(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f", value);
  return text;
}

}  // namespace

ChatterAdvice::ChatterAdvice(const MachineFile& machine, const StackPlan& plan)
    : machine_(machine) {
  config_.sample_period_s = plan.config.spindle.chatter.sample_period_s;
  const auto& observer = plan.config.spindle.observer;
  config_.disturbance_cutoff_rad_s = observer.disturbance_cutoff_rad_s;
  config_.velocity_cutoff_rad_s = observer.velocity_cutoff_rad_s;
  if (const auto teeth = machine.number("tool", "teeth"))
    config_.teeth = static_cast<unsigned>(*teeth);
  for (const char* section : {"structure.x", "structure.y"})
    if (const auto modes = machine.triples(section, "modes"))
      for (const auto& mode : *modes) config_.natural_frequencies_hz.push_back(mode[0]);
}

void ChatterAdvice::alarm(std::size_t event) {
  if (event_) return;
  event_ = event;
  torque_Nm_.clear();
  angle_rad_.clear();
  renewed_.clear();
  turned_rad_ = 0;
}

std::optional<ChatterAdviceResult> ChatterAdvice::add(const HostStack::Drive& spindle) {
  if (!event_) return std::nullopt;
  if (has(spindle.quality, Quality::gap | Quality::settling | Quality::restarted)) return finish();
  turned_rad_ += spindle.sample.increment;
  torque_Nm_.push_back(spindle.estimate);
  angle_rad_.push_back(turned_rad_);
  renewed_.push_back(has(spindle.sample.quality, Quality::held) ? 0 : 1);
  const double turns = std::abs(turned_rad_) / kTwoPi;
  const auto samples = static_cast<double>(torque_Nm_.size());
  const bool enough = turns >= kTurns && samples * config_.sample_period_s >= kLeast_s;
  if (enough || (turns >= kFewestTurns && torque_Nm_.size() >= kMost)) return finish();
  return std::nullopt;
}

std::optional<ChatterAdviceResult> ChatterAdvice::finish() {
  if (!event_) return std::nullopt;
  ChatterAdviceResult result;
  result.event = *event_;
  event_.reset();
  result.line = chatter_line(torque_Nm_, angle_rad_, renewed_, config_);
  const ChatterLine& line = result.line;
  if (line.verdict == ChatterLineVerdict::told)
    result.reason = "; the structure swings at " + whole(line.frequency_hz) + " Hz";
  else if (line.candidates_hz.size() == 2)
    result.reason = "; the structure swings at " + whole(line.candidates_hz[0]) + " or " +
                    whole(line.candidates_hz[1]) + " Hz";
  else
    result.reason = "; no frequency stands out clearly enough to be told";
  if (line.verdict == ChatterLineVerdict::told) {
    result.speeds_rpm = stable_speeds(line.spindle_speed_rpm, result.speed_step_rpm);
    if (!result.speeds_rpm.empty()) {
      std::string list;
      for (const double rpm : result.speeds_rpm) list += (list.empty() ? "" : " or ") + whole(rpm);
      result.reason += "; stable at the depth in [cut]: " + list + " rpm";
    }
  }
  return result;
}

// The nearest stable speeds on either side, in the middle of their pocket, where the file has
// structure, tool and cut.
std::vector<double> ChatterAdvice::stable_speeds(double present_rpm, double& step_rpm) const {
  std::vector<double> speeds;
  if (config_.natural_frequencies_hz.empty() || !machine_.has("cut", "axial_depth_m") ||
      !machine_.has("tool", "tangential_coefficient_N_per_m2"))
    return speeds;
  const auto m = milling_simulation(machine_, 1);
  if (!m) return speeds;
  const auto exact = SemiDiscretization::create(m->structure, m->tool, m->cut);
  if (!exact) return speeds;
  step_rpm = 0.01 * present_rpm;
  const auto stable = [&](double rpm) {
    return exact->spectral_radius(rpm, m->cut.axial_depth_m) < 1;
  };
  for (const double way : {-1.0, 1.0}) {
    double from = 0, to = 0;
    const double end = way < 0 ? -0.5 : 1.0;
    for (double part = way * (kPresent + 0.01); way * part <= way * end; part += way * 0.01) {
      const double rpm = present_rpm * (1 + part);
      if (stable(rpm)) {
        if (from == 0) from = rpm;
        to = rpm;
      } else if (from > 0) {
        break;
      }
    }
    if (from > 0 && std::abs(to - from) >= 2 * step_rpm) speeds.push_back(0.5 * (from + to));
  }
  return speeds;
}

}  // namespace servosense::cli
