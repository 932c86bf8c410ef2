#include "slow_chatter_watch.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "servosense/core/plausible.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/lag_gain.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/observer/machine_config.hpp"

namespace servosense::cli {
namespace {

constexpr double kEnds = 0.8;  // of the level: an alarm ends below it
// Where no mode of the structure is stated: the middle of what tools and holders chatter at, 300 to
// 1500 Hz. Convention.
constexpr double kChatter_hz = 700;
// Folded frequencies are named up to here, and where the drive's filter leaves so much.
constexpr double kNamedTo_hz = 2000;
constexpr double kShown = 0.03;
constexpr std::size_t kMostNamed = 5;

std::string figure(double value, const char* format = "%.3g") {
  char text[32];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

double most_compliant_hz(const MachineFile& machine) {
  double compliance = 0, hz = 0;
  for (const char* section : {"structure.x", "structure.y"})
    if (const auto modes = machine.triples(section, "modes"))
      for (const auto& m : *modes)
        if (const double c = 1 / (m[0] * m[0] * m[1] * m[2]); c > compliance) {
          compliance = c;
          hz = m[0];
        }
  return hz;
}

}  // namespace

bool is_slow(double sample_period_s) {
  const double rate = 1 / sample_period_s;
  return rate >= SlowVibration::kLeastRate_hz * (1 - kSameRate) &&
         rate <= SlowVibration::kMostRate_hz * (1 + kSameRate);
}

SlowVibrationConfig slow_vibration_config(const MachineFile& machine, Channel spindle,
                                          double sample_period_s) {
  const std::string section = monitor_section(MonitorId::chatter, spindle);
  SlowVibrationConfig c;
  c.sample_period_s = sample_period_s;
  if (spindle == tool_spindle(machine))
    c.teeth = static_cast<unsigned>(machine.number("tool", "teeth").value_or(0));
  c.threshold_Nm2 = machine.number(section, "line_threshold_Nm2").value_or(0);
  if (const auto lines = machine.list(section, "own_lines_hz")) c.own_lines_hz = *lines;
  return c;
}

SlowChatterWatch::SlowChatterWatch(const MachineFile& machine, StackPlan& plan,
                                   double sample_period_s)
    : rate_hz_(1 / sample_period_s) {
  if (rate_hz_ < SlowVibration::kLeastRate_hz * (1 - kSameRate))
    for (MonitorAvailability& m : plan.monitors)
      if (m.monitor == MonitorId::chatter && m.obstacle == "slow signal")
        m.reason = "needs at least " + figure(SlowVibration::kLeastRate_hz) +
                   " Hz to hear lines of the current, the signal has " + figure(rate_hz_) + " Hz";
  if (!is_slow(sample_period_s)) return;
  for (MonitorAvailability& m : plan.monitors) {
    if (m.monitor != MonitorId::chatter || plan.slot_of(m.channel) == nullptr) continue;
    const std::string section = monitor_section(MonitorId::chatter, m.channel);
    if (!machine.flag(section, "enabled").value_or(true)) continue;
    // Multiples are taken off by angle: a speed that is half a percent off leaves them all.
    if (machine.has(section_of(m.channel), "constant_speed_rpm")) {
      if (!m.runs && m.obstacle == "slow signal")
        m.reason += "; lines of the current could be heard with a measured angle or speed";
      continue;
    }
    const SlowVibrationConfig config = slow_vibration_config(machine, m.channel, sample_period_s);
    if (!(config.threshold_Nm2 > 0)) {
      if (!m.runs && m.obstacle == "slow signal")
        m.reason +=
            "; lines of the current can be heard all the same: run 'servosense identify "
            "idle', which learns line_threshold_Nm2 in [" +
            section + "]";
      continue;
    }
    // Lines need less torque and cry wolf more often (docs/slow-records.md): whoever wants them
    // where revolutions can be heard, too, says so.
    if (m.runs) {
      m.reason += "; with chatter_threshold_Nm2 taken out of [" + section +
                  "] it hears lines of the current in their place: less torque, more alarms";
      continue;
    }
    const double learned = machine.number(section, "learned_sample_rate_hz").value_or(rate_hz_);
    if (std::abs(learned - rate_hz_) > kSameRate * rate_hz_) continue;  // the plan says so
    HostStackConfig& config_of = m.channel == plan.tool_spindle ? plan.config : *plan.second;
    ChatterConfig& comb = config_of.spindle.chatter;
    config_of.spindle.chatter_on = false;
    comb.chatter_threshold_Nm2 = comb.forced_threshold_Nm2 = 0;
    Spindle spindle{m.channel, SlowVibration(config), "Nm"};
    comb.minimum_speed_rad_s = std::min(spindle.ear.minimum_speed_rad_s(), 0.1 / sample_period_s);
    const std::string_view own = section_of(m.channel);
    if (machine.flag(own, "current_is_ratio").value_or(false)) spindle.unit = "ratio";
    spindle.filter_hz = machine.number(own, "current_filter_hz").value_or(0);
    spindle.asked_hz = m.channel == plan.tool_spindle ? most_compliant_hz(machine) : 0;
    if (!(spindle.asked_hz > 0)) spindle.asked_hz = kChatter_hz;
    m.runs = true;
    m.obstacle.clear();
    m.reason = "listens for lines that do not turn with the spindle, from " +
               figure(rpm_from_rad_s(spindle.ear.minimum_speed_rad_s()), "%.0f") +
               " rpm on, over " +
               figure(2 * static_cast<double>(spindle.ear.window()) * sample_period_s) +
               " s; what is faster than " + figure(rate_hz_ / 2) + " Hz appears folded below that";
    spindles_.push_back(std::move(spindle));
  }
}

bool SlowChatterWatch::takes(Channel channel) const {
  return std::any_of(spindles_.begin(), spindles_.end(),
                     [&](const Spindle& s) { return s.channel == channel; });
}

std::string SlowChatterWatch::reason(const Spindle& spindle, const SlowVibrationVerdict& v) const {
  std::vector<double> all = folded_frequencies(v.apparent_hz, rate_hz_, kNamedTo_hz);
  std::string named;
  std::size_t count = 0;
  for (const double hz : all) {
    if (lag_gain(hz, spindle.filter_hz) < kShown || count == kMostNamed) break;
    named += (count == 0 ? "" : ", ") + figure(hz, "%.0f");
    ++count;
  }
  return "non-synchronous vibration of " + figure(std::sqrt(2 * v.line_Nm2)) + " " + spindle.unit +
         " in the reported current; frequency unknown: one of " + named +
         (count < all.size() ? " ..." : "") + " Hz";
}

std::vector<SlowChatterWatch::Change> SlowChatterWatch::sample(double t_s,
                                                               const MachineStack& stack) {
  std::vector<Change> out;
  for (Spindle& s : spindles_) {
    const auto& in = stack.drive(s.channel).sample;
    const auto v = s.ear.add(in.effort, in.increment, in.quality);
    MonitorState now = s.state;
    if (v) {
      s.since = 0;
      s.needed_Nm2 += v->needed_Nm2;
      s.heard_share += v->heard_share;
      s.largest_Nm = std::max(s.largest_Nm, std::abs(v->mean_Nm));
      ++s.verdicts;
      const double level = s.state == MonitorState::alarm ? kEnds : 1;
      now = v->value >= level ? MonitorState::alarm : MonitorState::armed;
    } else if (++s.since > s.ear.window()) {
      now = MonitorState::idle;  // too slow, or its speed runs away
    }
    if (now == s.state) continue;
    Change c;
    const double value = v ? v->line_Nm2 : 0;
    const double threshold = v && v->value > 0 ? v->line_Nm2 / v->value : 0;
    c.change = {MonitorId::chatter, s.channel, now, s.state, value, threshold};
    c.event.t_s = t_s;
    c.event.monitor = MonitorId::chatter;
    c.event.channel = std::string(name_of(s.channel));
    c.event.state = now;
    c.event.value = value;
    c.event.threshold = threshold;
    c.event.unit = "Nm2";
    c.event.reason = now == MonitorState::alarm   ? reason(s, *v)
                     : now == MonitorState::armed ? "watching"
                                                  : "the spindle turns too slowly or unevenly";
    s.state = now;
    out.push_back(std::move(c));
  }
  return out;
}

void SlowChatterWatch::tell(StackPlan& plan) const {
  for (const Spindle& s : spindles_)
    for (MonitorAvailability& m : plan.monitors) {
      if (m.monitor != MonitorId::chatter || m.channel != s.channel) continue;
      if (s.verdicts == 0) {
        m.reason = "has judged nothing: the spindle has not turned fast and evenly enough for " +
                   figure(2 * static_cast<double>(s.ear.window()) / rate_hz_) + " s; " + m.reason;
        continue;
      }
      const auto n = static_cast<double>(s.verdicts);
      const double shown = std::sqrt(2 * s.needed_Nm2 / n);
      const auto torque = [&](double hz) {
        return figure(shown / lag_gain(hz, s.filter_hz)) + " " + s.unit;
      };
      SeesFrom seen;
      seen.value = shown / lag_gain(s.asked_hz, s.filter_hz);
      seen.unit = s.unit;
      seen.frequency_hz = s.asked_hz;
      seen.blind = seen.value > s.largest_Nm && s.state != MonitorState::alarm;
      const std::string at = "at " + figure(s.asked_hz, "%.0f") + " Hz";
      if (seen.blind)
        seen.text = "cannot see chatter here: " + at + " it takes " + torque(s.asked_hz) +
                    ", and the cuts of the record have " + figure(s.largest_Nm) + " " + s.unit +
                    " at most";
      else
        seen.text = "chatter " + at + " from " + torque(s.asked_hz);
      if (s.filter_hz > 0)
        seen.text += " (" + figure(shown) + " " + s.unit + " behind the drive's filter of " +
                     figure(s.filter_hz) + " Hz; at 300 Hz " + torque(300) + ", at 1500 Hz " +
                     torque(1500) + ")";
      else
        seen.text +=
            " in the reported current; what the drive's filter takes of it is not known "
            "(current_filter_hz)";
      seen.text += ", at " + figure(100 * s.heard_share / n, "%.0f") + " % of all frequencies";
      m.reason = (seen.blind ? "" : "sees ") + seen.text + "; " + m.reason;
      m.sees_from = std::move(seen);
    }
}

}  // namespace servosense::cli
