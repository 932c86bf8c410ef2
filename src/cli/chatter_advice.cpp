#include "chatter_advice.hpp"

#include <cmath>
#include <cstdio>
#include <utility>

#include "servosense/core/units.hpp"
#include "servosense/identify/semi_discretization.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::cli {
namespace {

constexpr double kTurns = 16, kFewestTurns = 8, kLeast_s = 0.25;
constexpr std::size_t kMost = 4096;             // samples, where that is eight revolutions
constexpr double kPresent = 0.02;               // of the present speed, where nothing is advised
constexpr double kSlowest = 0.5, kFastest = 2;  // of it, between which speeds are looked for

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

void ChatterAdvice::alarm(std::size_t event, const StateChange<double>& change) {
  if (stretch_) return;
  stretch_.emplace().event = event;
  stretch_->line_hz = change.frequency_hz;
  stretch_->line_error_hz = change.error_hz;
  faint_ = change.frequency_hz > 0;
  turned_rad_ = 0;
}

std::optional<ChatterStretch> ChatterAdvice::add(const HostStack& stack) {
  if (!stretch_) return std::nullopt;
  const HostStack::Drive& spindle = stack.spindle();
  const auto& power = stack.chatter().alarm(ChatterSign::power).state();
  if (faint_ && power.state == MonitorState::alarm) {
    faint_ = false;
    turned_rad_ = 0;
    stretch_->torque_Nm.clear();
    stretch_->angle_rad.clear();
    stretch_->renewed.clear();
  }
  if (has(spindle.quality, Quality::gap | Quality::settling | Quality::restarted)) return finish();
  turned_rad_ += spindle.sample.increment;
  stretch_->torque_Nm.push_back(spindle.estimate);
  stretch_->angle_rad.push_back(turned_rad_);
  stretch_->renewed.push_back(has(spindle.sample.quality, Quality::held) ? 0 : 1);
  const double turns = std::abs(turned_rad_) / kTwoPi;
  const std::size_t samples = stretch_->torque_Nm.size();
  const bool enough =
      turns >= kTurns && static_cast<double>(samples) * config_.sample_period_s >= kLeast_s;
  if (enough || (turns >= kFewestTurns && samples >= kMost)) return finish();
  return std::nullopt;
}

std::optional<ChatterStretch> ChatterAdvice::finish() { return std::exchange(stretch_, {}); }

ChatterAdviceResult ChatterAdvice::look_into(const ChatterStretch& stretch) const {
  ChatterAdviceResult result;
  result.event = stretch.event;
  result.line = chatter_line(stretch.torque_Nm, stretch.angle_rad, stretch.renewed, config_);
  const ChatterLine& line = result.line;
  if (stretch.line_hz > 0 &&
      (line.verdict == ChatterLineVerdict::silent || line.verdict == ChatterLineVerdict::forced))
    result.line =
        chatter_line_at(stretch.line_hz, stretch.line_error_hz, line.spindle_speed_rpm, config_);
  if (line.verdict == ChatterLineVerdict::told)
    result.reason = "; the structure swings at " + whole(line.frequency_hz) + " Hz";
  else if (line.candidates_hz.size() == 2)
    result.reason = "; the structure swings at " + whole(line.candidates_hz[0]) + " or " +
                    whole(line.candidates_hz[1]) + " Hz";
  else if (line.verdict == ChatterLineVerdict::undecided)
    result.reason = "; the torque swings at " + whole(line.line_hz) +
                    " Hz, the structure there or a tooth frequency beside" +
                    (config_.teeth == 0 ? ": write teeth in [tool]" : "");
  else if (line.verdict == ChatterLineVerdict::forced)
    result.reason = "; the strongest line, " + whole(line.line_hz) +
                    " Hz, lies at a harmonic of the rotation or of the teeth";
  else
    result.reason = "; no frequency stands out clearly enough to be told";
  const double present_rpm = line.spindle_speed_rpm;
  AdvisedSpeeds speeds =
      advised_speeds(present_rpm, kSlowest * present_rpm, kFastest * present_rpm);
  result.speeds_rpm = std::move(speeds.rpm);
  result.speed_step_rpm = speeds.step_rpm;
  result.reason += speeds.clause;
  return result;
}

AdvisedSpeeds ChatterAdvice::advised_speeds(double present_rpm, double slowest_rpm,
                                            double fastest_rpm) const {
  AdvisedSpeeds found;
  const auto none = [&](const std::string& why) {
    found.clause = "; no speed is known to be stable: " + why;
    return found;
  };
  if (!(present_rpm > 0)) return none("the chatter ended within eight revolutions");
  if (config_.natural_frequencies_hz.empty())
    return none("the file has no modes in [structure.x] and [structure.y]");
  for (const auto& [section, key] :
       {std::pair{"cut", "axial_depth_m"}, std::pair{"tool", "tangential_coefficient_N_per_m2"}})
    if (!machine_.has(section, key) && !machine_.has(section, "coefficients"))
      return none(std::string("the file has no ") + key + " in [" + section + "]");
  const auto m = milling_simulation(machine_, 1);
  if (!m) return none(m.error().sentence);
  const auto exact = SemiDiscretization::create(m->structure, m->tool, m->cut);
  if (!exact) return none(exact.error().sentence);
  const auto stable = [&](double rpm) {
    return exact->spectral_radius(rpm, m->cut.axial_depth_m) < 1;
  };
  if (stable(present_rpm))
    return none("by structure and cut of the file " + whole(present_rpm) +
                " rpm is, so they are not those of this cut");
  found.step_rpm = 0.01 * present_rpm;
  std::string list;
  for (const double way : {-1.0, 1.0}) {
    double from = 0, to = 0;
    const double end = way < 0 ? slowest_rpm : fastest_rpm;
    for (double rpm = present_rpm * (1 + way * (kPresent + 0.01)); way * rpm <= way * end;
         rpm += way * found.step_rpm) {
      if (stable(rpm)) {
        if (from == 0) from = rpm;
        to = rpm;
      } else if (from > 0) {
        break;
      }
    }
    if (from > 0 && std::abs(to - from) >= 2 * found.step_rpm) {
      const double rpm = 0.5 * (from + to);
      found.rpm.push_back(rpm);
      list += (list.empty() ? "" : " or ") + whole(rpm);
    }
  }
  if (list.empty())
    return none("at the depth in [cut] the file has none from " + whole(slowest_rpm) + " to " +
                whole(fastest_rpm) + " rpm");
  found.clause = "; stable at the depth in [cut]: " + list + " rpm, each known to " +
                 whole(found.step_rpm) + " rpm";
  return found;
}

}  // namespace servosense::cli
