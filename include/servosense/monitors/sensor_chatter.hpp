// Chatter heard by an accelerometer or a microphone, over the angle of the spindle.
//
// Purpose: the chatter monitor (chatter.hpp) beside a monitor stack, in the unit of a sensor that
// is sampled with the drives: power beyond the revolution, and narrow lines (chatter_lines.hpp).
// Equation: those of the blocks, "torque" being the signal behind a high-pass of 20 Hz, so that
// gravity and offset are no load. The angle, the feed and whether nothing is cut come from the
// stack. Of the noise of a sensor nothing is known in advance, so a line is judged by what it
// stands over the mean m of N lines beside it (cell averaging, Finn and Johnson 1968), which of
// Gaussian noise, white or of even colour, exceeds x with the probability (1 + x / N)^-N, whatever
// its level and its unit. N is 4.7: eight lines of a Hann window of which neighbours share 4/9
// and 1/36 (Harris 1978). The alarm takes the score in five transforms in a row, which are two
// windows that share nothing: each of 256 lines, squared (sensor_line_threshold).
// Lines of the machine itself (fans, pumps, mains), learned in the air, are left out with two lines
// to either side, also where the rate of the parts folds them to.
// The power has a threshold from the air, and half of the load is left to the cut: more of the
// vibration is off the rotation than on it, in four revolutions in a row, of which the comb
// compares the last with none of the first. The share that a line is left (tolerated_load_share) is
// its own. Delay: 0.15 s for the first transform of a line, 0.16 s more for five; of the power one
// revolution.
// Cost on Cortex-M4F: that of chatter with lines, and some 10 instructions.
// Range: |value| < 1e15, from three samples a tooth on. A part of a revolution is 2.4 samples or
// more: at 8 kHz what is faster than some 1.6 kHz is damped and folded below that.
// Numerical bound: that of the blocks; the high-pass is a contraction.
// Bad at: what is faster than a fifth of the sample rate; lines of the machine that the air does
// not have (a pump that starts with the cut); a bearing whose lines move with the speed and are no
// multiples of it; a lightly damped structure that the noise of the cut rings (below a damping
// ratio of 0.5 % it is as narrow as a line); chatter within 1.2 lines of a harmonic of the
// rotation.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "servosense/core/channel.hpp"
#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/core/status.hpp"
#include "servosense/dsp/first_order.hpp"
#include "servosense/monitors/chatter.hpp"
#include "servosense/monitors/monitor_stack.hpp"

namespace servosense {

/// Score that noise holds for five transforms in a row so often.
[[nodiscard]] inline double sensor_line_threshold(double sample_period_s,
                                                  double false_alarms_per_hour) noexcept {
  constexpr double kBeside = 4.7, kLines = 256;
  const double each =
      std::sqrt(false_alarms_per_hour / line_transforms_per_hour(sample_period_s)) / kLines;
  return kBeside * (std::pow(each, -1 / kBeside) - 1);
}

[[nodiscard]] inline double usual_sensor_line_threshold(
    double sample_period_s, double false_alarms_per_hour = 0.01) noexcept {
  return kLineMargin * sensor_line_threshold(sample_period_s, false_alarms_per_hour);
}

struct SensorChatterConfig {
  Channel channel = Channel::accelerometer;
  /// Torques stand for the signal: Nm2 for the square of its unit. Teeth, window and speeds are
  /// those of the spindle's.
  ChatterConfig chatter;
  double highpass_rad_s = kTwoPi * 20;
  std::array<double, 8> own_lines_hz{};  ///< of the machine; 0: none
};

/// Before anything is learned; the rest is the spindle's.
[[nodiscard]] inline SensorChatterConfig sensor_chatter_defaults(Channel channel,
                                                                 double sample_period_s) noexcept {
  SensorChatterConfig c;
  c.channel = channel;
  c.chatter.sample_period_s = sample_period_s;
  c.chatter.tolerated_load_share = 0.01;
  c.chatter.consecutive_revolutions = 4;
  c.chatter.lines.threshold = usual_sensor_line_threshold(sample_period_s);
  c.chatter.minimum_speed_rad_s = std::min(c.chatter.minimum_speed_rad_s, 0.5 / sample_period_s);
  return c;
}

/// Sizes: those of ChatterMonitor.
template <RealNumber Real, std::size_t Revolutions = 8, std::size_t Harmonics = 10>
class SensorChatter {
 public:
  using Config = SensorChatterConfig;
  using Chatter = ChatterMonitor<Real, Revolutions, Harmonics, 1, ChatterNoise::sensor>;

  static Status validate(const Config& c) noexcept {
    if (!is_sensor(c.channel)) return Status::invalid("channel", "must be that of a sensor");
    if (!(c.highpass_rad_s > 0 && c.highpass_rad_s * c.chatter.sample_period_s < 1))
      return Status::invalid("highpass_rad_s", "must be positive, below the sample rate");
    for (const double hz : c.own_lines_hz)
      if (!(hz >= 0 && is_finite(hz)))
        return Status::invalid("own_lines_hz", "must be zero (none) or positive");
    if (!(c.chatter.lines.threshold > 0 || c.chatter.chatter_threshold_Nm2 > 0))
      return Status::invalid("lines.threshold", "must be positive: it could not alarm");
    return Chatter::validate(c.chatter);
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    channel_ = c.channel;
    low_.configure({c.highpass_rad_s, c.chatter.sample_period_s});
    ChatterConfig chatter = c.chatter;
    chatter.cutting_torque_Nm = 0;
    chatter_.configure(chatter);
    chatter_.set_own_lines(c.own_lines_hz);
    by_power_ = chatter.chatter_threshold_Nm2 > 0;
    reset();
  }
  void reset() noexcept {
    low_.reset();
    chatter_.reset();
    primed_ = false;
    before_ = MonitorState::idle;
  }

  /// The sensor's value of the servo period that `stack`, not in groups, has just heard, and what
  /// is known against it. True when the state has changed: `change` says how.
  template <typename Stack>
  bool process(const Stack& stack, Real value, Quality quality,
               StateChange<Real>& change) SERVOSENSE_NONBLOCKING {
    const auto& spindle = stack.spindle().sample;
    chatter_.tell_air(stack.cut().state().cut == CutPresence::air);
    const MonitorState state =
        hear(value, spindle.turn_angle_rad, spindle.increment, quality | spindle.quality);
    if (chatter_.asks_position()) chatter_.follow_feed(stack.chatter().state().feed);
    return changed(state, change);
  }
  /// What a stack knows of the cut, where there is none: as in chatter.hpp.
  void tell_air(bool air) noexcept { chatter_.tell_air(air); }
  void tell_position(const std::array<Real, 3>& position_m) noexcept {
    chatter_.tell_position(position_m);
  }
  /// The same without a stack.
  MonitorState hear(Real value, Real turn_angle_rad, Real increment_rad,
                    Quality quality) SERVOSENSE_NONBLOCKING {
    if (!is_finite(value)) quality |= Quality::invalid;
    if (!has(quality, kUnusable)) {
      if (!primed_) low_.prime(value);
      primed_ = true;
      last_ = value - low_.process(value);
    }
    return chatter_.process(last_, turn_angle_rad, increment_rad, quality);
  }

  [[nodiscard]] const Chatter& chatter() const noexcept { return chatter_; }
  [[nodiscard]] Channel channel() const noexcept { return channel_; }
  /// What the present state is of.
  [[nodiscard]] ChatterSign sign() const noexcept {
    const ChatterSign sign = chatter_.sign();
    return sign == ChatterSign::power && !by_power_ ? ChatterSign::line : sign;
  }

 private:
  bool changed(MonitorState state, StateChange<Real>& change) noexcept {
    if (state == before_) return false;
    const ChatterSign of = sign();
    change = {};
    change.monitor = MonitorId::chatter;
    change.channel = channel_;
    change.state = state;
    change.before = before_;
    change.value = chatter_.value(of);
    change.threshold = chatter_.alarm(of).threshold();
    change.detail = static_cast<std::uint8_t>(of);
    if (of == ChatterSign::line) {
      change.frequency_hz = chatter_.lines().state().found.frequency_hz;
      change.error_hz = chatter_.lines().state().found.error_hz;
    }
    before_ = state;
    return true;
  }

  Chatter chatter_;
  LowPass<Real> low_;
  Real last_ = 0;
  bool primed_ = false;
  bool by_power_ = false;
  Channel channel_ = Channel::accelerometer;
  MonitorState before_ = MonitorState::idle;
};

}  // namespace servosense
