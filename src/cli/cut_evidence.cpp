#include "cut_evidence.hpp"

#include <cmath>
#include <map>

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"
#include "servosense/sim/simulation_config.hpp"

namespace servosense::cli {
namespace {

constexpr unsigned kApart = 8;  // turns of air between two cuts (chosen: the monitor's window)
// Teeth after which chatter would have come up (chosen: what grows by 1 % a tooth, the soft margin
// of identify/watched_cuts.hpp, has then grown twentyfold).
constexpr double kGrown_teeth = 300;
constexpr double kMostMissed = 0.1;  // of the turns, not judged (chosen: as in the verdict)
constexpr double kSteady = 0.01;     // standard deviation of the speed (chosen: a lobe is wider)

std::string cuts_text(std::size_t count, const char* kind) {
  return std::to_string(count) + " " + kind + (count == 1 ? " cut" : " cuts");
}

}  // namespace

WatchedCut watched_cut_of(const MillingCut& cut) {
  WatchedCut watched;
  watched.axial_depth_m = cut.axial_depth_m;
  watched.direction = cut.direction == MillingDirection::slot ? "slot"
                      : cut.direction == MillingDirection::up ? "up"
                                                              : "down";
  if (cut.direction != MillingDirection::slot) watched.radial_immersion_m = cut.radial_immersion_m;
  return watched;
}

Expected<CutEvidence> CutEvidence::create(const MachineFile& machine, const StackPlan& plan,
                                          double sample_period_s) {
  const auto cut = milling_cut(machine);
  if (!cut) return cut.error();
  const auto teeth = machine.required_number("tool", "teeth");
  if (!teeth) return teeth.error();
  CutEvidence e;
  e.teeth_ = static_cast<unsigned>(*teeth);
  e.engagement_ = watched_cut_of(*cut);
  e.spindle_ = plan.tool_spindle;
  e.period_s_ = sample_period_s;
  const ChatterConfig& chatter = plan.stack_of(e.spindle_).spindle.chatter;
  e.cutting_Nm_ = chatter.cutting_torque_Nm;
  e.slowest_rad_s_ = chatter.minimum_speed_rad_s;
  return e;
}

void CutEvidence::alarm(MonitorId monitor, Channel channel, std::size_t event) {
  if (!now_ || monitor == MonitorId::signal) return;
  if (monitor != MonitorId::chatter)
    now_->other_alarm = true;
  else if (channel == spindle_ && !now_->event)
    now_->event = event;
}

void CutEvidence::begin_turn(const HostStack& stack) {
  turned_rad_ = torque_sum_ = 0;
  samples_ = 0;
  verdicts_ = stack.chatter().state().verdicts;
}

void CutEvidence::sample(double t_s, const MachineStack& stack) {
  const HostStack& own = stack.stack_of(spindle_);
  const HostStack::Drive& drive = stack.drive(spindle_);
  if (has(drive.quality, Quality::gap | Quality::settling)) {
    if (now_ && samples_ > 0) ++now_->missed;
    return begin_turn(own);
  }
  turned_rad_ += drive.sample.increment;
  torque_sum_ += drive.estimate;
  ++samples_;
  if (std::abs(turned_rad_) >= kTwoPi) {
    end_turn(t_s, own);
    begin_turn(own);
  } else if (static_cast<double>(samples_) * period_s_ * slowest_rad_s_ > kTwoPi) {
    end_cut();
    begin_turn(own);
  }
}

void CutEvidence::end_turn(double t_s, const HostStack& stack) {
  const auto samples = static_cast<double>(samples_);
  if (!(cutting_Nm_ > 0) || std::abs(torque_sum_) < cutting_Nm_ * samples) {
    if (now_ && ++now_->air >= kApart) end_cut();
    return;
  }
  if (!now_) now_.emplace().from_s = t_s - samples * period_s_;
  Cut& cut = *now_;
  cut.to_s = t_s;
  cut.air = 0;
  ++cut.turns;
  const double speed = std::abs(turned_rad_) / (samples * period_s_);
  cut.torque_sum += std::abs(torque_sum_) / samples;
  cut.speed_sum += speed;
  cut.speed_squares += speed * speed;
  const auto& chatter = stack.chatter();
  const MonitorState power = chatter.alarm(ChatterSign::power).state().state;
  cut.alarmed = cut.alarmed || chatter.state().state == MonitorState::alarm;
  cut.warned = cut.warned || power == MonitorState::warning;
  if (chatter.state().verdicts > verdicts_ && chatter.state().signal == SignalState::good &&
      chatter.state().feed.steady() && !chatter.stepped())
    ++cut.judged;
  else if (cut.judged > 0)
    ++cut.missed;
}

void CutEvidence::end_cut() {
  if (now_) cuts_.push_back(*now_);
  now_.reset();
}

std::string CutEvidence::why_not(const Cut& cut, const MonitorRun& run, std::size_t i) const {
  const auto turns = static_cast<double>(cut.turns);
  const double mean = cut.speed_sum / turns;
  if (cut.speed_squares / turns - mean * mean > kSteady * kSteady * mean * mean)
    return "the speed of the spindle changed ('servosense pockets' is for that)";
  if (cut.other_alarm) return "another monitor alarmed";
  if (cut.alarmed) return {};
  if (cut.warned) return "the chatter monitor warned, and did not alarm";
  const MonitorAvailability& monitor = run.plan.monitors[i];
  if (!run.watched[i].why.empty())
    return "the chatter monitor did not watch all the time: " + run.watched[i].why;
  if (!monitor.sees_from) return "the chatter monitor has judged nothing";
  if (cut.torque_sum / turns < monitor.sees_from->in_cut.value_or(monitor.sees_from->value))
    return "its torque is less than that of chatter that would be heard";
  if (monitor.sees_from->unheard_mode_hz)
    return "the structure's " + printed(*monitor.sees_from->unheard_mode_hz, 3) +
           " Hz are beyond what these signals show";
  if (static_cast<double>(cut.judged) * teeth_ < kGrown_teeth)
    return "the chatter monitor judged less than " + printed(kGrown_teeth, 3) + " teeth of it";
  if (static_cast<double>(cut.missed) > kMostMissed * turns)
    return "the chatter monitor judged too little of it: the feed was not steady, the torque "
           "stepped or the signal was faulty";
  return {};
}

CutEvidence::Told CutEvidence::tell(const MonitorRun& run) {
  end_cut();
  Told told;
  const auto none = [&](const std::string& why) {
    told.remarks.push_back("--cuts: no cut was written: " + why);
    return told;
  };
  std::size_t i = 0;
  while (i < run.plan.monitors.size() && (run.plan.monitors[i].monitor != MonitorId::chatter ||
                                          run.plan.monitors[i].channel != spindle_))
    ++i;
  if (i == run.plan.monitors.size()) return none("the spindle of the tool has no chatter monitor");
  if (!run.plan.monitors[i].runs)
    return none("the chatter monitor does not run: " + run.plan.monitors[i].reason);
  if (!run.plan.stack_of(spindle_).spindle.chatter_on)
    return none("this record is so slow that revolutions cannot be told apart");
  if (!(cutting_Nm_ > 0))
    return none(
        "what torque means cutting is not known; 'servosense identify idle' learns "
        "cutting_torque_Nm of [monitor.collision]");
  if (cuts_.empty()) return none("the torque shows none");
  std::map<std::string, std::size_t> silent;
  std::size_t stable = 0;
  for (const Cut& cut : cuts_) {
    if (const std::string why = why_not(cut, run, i); !why.empty()) {
      ++silent[why];
      continue;
    }
    WatchedCut line = engagement_;
    line.spindle_speed_rpm = rpm_from_rad_s(cut.speed_sum / static_cast<double>(cut.turns));
    line.stable = !cut.alarmed;
    line.note = run.trace + ", " + printed(cut.from_s, 4) + " to " + printed(cut.to_s, 4) + " s";
    for (const ChatterAdviceResult& advice : run.advice)
      if (cut.event == advice.event && advice.line.verdict == ChatterLineVerdict::told)
        line.chatter_hz = advice.line.frequency_hz;
    if (line.stable) ++stable;
    told.cuts.push_back(std::move(line));
  }
  if (!told.cuts.empty())
    told.remarks.push_back("--cuts: " + cuts_text(stable, "stable") + " and " +
                           cuts_text(told.cuts.size() - stable, "chattering") + " written");
  for (const auto& [why, count] : silent)
    told.remarks.push_back("--cuts: " + std::to_string(count) +
                           (count == 1 ? " cut gave" : " cuts gave") + " no line: " + why);
  return told;
}

}  // namespace servosense::cli
