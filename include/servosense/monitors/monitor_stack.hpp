// The monitor stack: every monitor on one sample.
//
// Purpose: spindle and up to three feed axes, from raw drive signals to states and alarms, once per
// servo period. Each drive: input conditioning, the observer whose estimate is reported, and the
// observer of its monitor where that one needs other cutoffs (Koike 2016, table 3-3: 335 rad/s for
// collision, 3500 rad/s for chatter). The spindle feeds the chatter monitor, each axis a collision
// monitor, every drive a signal health monitor, all of them together the monitors of the tool.
// Delay: that of the observers and monitors.
// Cost on Cortex-M4F: bench/firmware/instructions.csv, the rows monitor_stack,
// monitor_stack_two_observers and, with all of the tool, monitor_stack_tool. Memory: the whole
// stack is one object without heap. Revolutions and Harmonics size the chatter monitor;
// KeptSamples, 12 bytes each in float, are what a chatter alarm is replayed from; Teeth is the
// capacity of the breakage monitors, 0 leaves the monitors of the tool out altogether.
// Range and numerical bound: those of the blocks.
// Bad at: sums over drives (each is watched alone).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "servosense/core/channel.hpp"
#include "servosense/core/drive_sample.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/core/status.hpp"
#include "servosense/monitors/chatter.hpp"
#include "servosense/monitors/collision.hpp"
#include "servosense/monitors/cut_detector.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/signal_health.hpp"
#include "servosense/monitors/tool_monitors.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

/// One drive of the stack.
struct DriveSlotConfig {
  bool present = false;
  DriveInputConfig input;
  DisturbanceObserverConfig observer;          ///< of the reported estimate
  DisturbanceObserverConfig monitor_observer;  ///< of the monitor; equal cutoffs share one observer
  SignalHealthConfig signal;
};

struct SpindleSlotConfig : DriveSlotConfig {
  ChatterConfig chatter;
};

struct AxisSlotConfig : DriveSlotConfig {
  CollisionConfig collision;
  DisturbanceObserverConfig tool_observer;  ///< of x and y, for the monitors of the tool
};

struct MonitorStackConfig {
  SpindleSlotConfig spindle;
  std::array<AxisSlotConfig, kAxes> axis;
  CutDetectorConfig cut;  ///< for the collision monitors
  ToolMonitorsConfig tool;
};

/// A monitor whose state changed on this sample.
template <RealNumber Real>
struct StateChange {
  MonitorId monitor = MonitorId::signal;
  Channel channel = Channel::machine;
  MonitorState state = MonitorState::idle;
  MonitorState before = MonitorState::idle;
  Real value = 0;
  Real threshold = 0;
  /// chatter: 1 = forced vibration; tooth-breakage: 1 = a pattern that lasts; wear: WearRule;
  /// signal: SignalCause.
  std::uint8_t detail = 0;
};

template <RealNumber Real, std::size_t Revolutions = 8, std::size_t Harmonics = 10,
          std::size_t KeptSamples = 1024, std::size_t Teeth = 8>
class MonitorStack {
  struct NoTool {
    static constexpr std::size_t kMonitors = 0;
    static Status validate(const ToolMonitorsConfig&) noexcept { return {}; }
    void configure(const ToolMonitorsConfig&) noexcept {}
    void reset() noexcept {}
    [[nodiscard]] static bool any() noexcept { return false; }
  };

 public:
  using Config = MonitorStackConfig;
  using Chatter = ChatterMonitor<Real, Revolutions, Harmonics, KeptSamples>;
  using Collision = CollisionMonitor<Real>;
  using Observer = DisturbanceObserver<Real>;
  using Tool = std::conditional_t<(Teeth > 0), ToolMonitors<Real, (Teeth > 0 ? Teeth : 2)>, NoTool>;
  static constexpr std::size_t kMaxChanges = 2 * (1 + kAxes) + Tool::kMonitors;

  /// Everything of one drive that telemetry reads.
  struct Drive {
    DriveSample<Real> sample;
    Real estimate = 0;  ///< cutting torque [Nm] or force [N]
    Quality quality = Quality::settling;
    MonitorState state = MonitorState::idle;  ///< of chatter or collision
    MonitorState signal = MonitorState::learning;
  };

  static Status validate(const Config& c) noexcept {
    if (c.spindle.present) {
      if (const Status s = validate_slot(c.spindle); !s.ok()) return s;
      if (const Status s = Chatter::validate(c.spindle.chatter); !s.ok()) return s;
      if (const Status s = CutDetector<Real>::validate(c.cut); !s.ok()) return s;
    }
    for (const AxisSlotConfig& axis : c.axis) {
      if (!axis.present) continue;
      if (const Status s = validate_slot(axis); !s.ok()) return s;
      if (const Status s = Collision::validate(axis.collision); !s.ok()) return s;
    }
    if (const Status s = Tool::validate(c.tool); !s.ok()) return s;
    if (c.tool.needs_lateral_forces())
      for (std::size_t i = 0; i < 2; ++i)
        if (const Status s = Observer::validate(c.axis[i].tool_observer); !s.ok()) return s;
    return {};
  }

  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    spindle_.configure(c.spindle);
    if (c.spindle.present) chatter_.configure(c.spindle.chatter);
    cut_.configure(c.cut);
    for (std::size_t i = 0; i < kAxes; ++i) {
      axis_[i].configure(c.axis[i]);
      if (c.axis[i].present) collision_[i].configure(c.axis[i].collision);
    }
    tool_.configure(c.tool);
    tool_on_ = tool_.any();
    half_rate_ = c.tool.half_rate;
    lateral_on_ = Teeth > 0 && c.tool.needs_lateral_forces();
    if (lateral_on_)
      for (std::size_t i = 0; i < lateral_.size(); ++i)
        lateral_[i].configure(c.axis[i].tool_observer);
    reset();
  }

  void reset() noexcept {
    spindle_.reset();
    chatter_.reset();
    cut_.reset();
    for (std::size_t i = 0; i < kAxes; ++i) {
      axis_[i].reset();
      collision_[i].reset();
      collision_[i].stagger(static_cast<std::uint32_t>(i * Collision::kEvidenceStride / kAxes));
    }
    tool_.reset();
    for (Observer& observer : lateral_) observer.reset();
    last_lateral_ = {};
    last_spindle_ = last_thrust_ = {};
    change_count_ = 0;
    samples_ = 0;
  }

  /// One servo period. Returns the monitors whose state changed; valid until the next call.
  std::span<const StateChange<Real>> process(const ServoSample<Real>& in) SERVOSENSE_NONBLOCKING {
    change_count_ = 0;
    ++samples_;
    Heard torque{};
    CutPresence cut = CutPresence::air;
    if (spindle_.present) {
      torque = spindle_.process(in.spindle);
      if (spindle_.health.state().state != spindle_.out.signal)
        report_signal(spindle_, Channel::spindle);
      const DriveSample<Real>& s = spindle_.out.sample;
      const MonitorState state =
          chatter_.process(torque.value, s.turn_angle_rad, s.increment, torque.quality);
      if (state != spindle_.out.state) report_chatter(state);
      cut = cut_.process(torque.value, s.increment, torque.quality);
    }
    for (std::size_t i = 0; i < kAxes; ++i) {
      if (!axis_[i].present) continue;
      const Heard force = axis_[i].process(in.axis[i]);
      if (axis_[i].health.state().state != axis_[i].out.signal)
        report_signal(axis_[i], axis_channel(i));
      const MonitorState state =
          collision_[i].process(force.value, force.quality, axis_[i].out.sample.increment, cut);
      if (state != axis_[i].out.state) report_collision(i, state);
    }
    if (chatter_.asks_position()) tell_chatter();
    if constexpr (Teeth > 0)
      if (tool_on_) watch_tool(torque);
    return {changes_.data(), change_count_};
  }

  [[nodiscard]] const Drive& spindle() const noexcept { return spindle_.out; }
  [[nodiscard]] const Drive& axis(std::size_t i) const noexcept { return axis_[i].out; }
  [[nodiscard]] const Chatter& chatter() const noexcept { return chatter_; }
  [[nodiscard]] const Collision& collision(std::size_t i) const noexcept { return collision_[i]; }
  [[nodiscard]] const CutDetector<Real>& cut() const noexcept { return cut_; }
  [[nodiscard]] const Tool& tool() const noexcept { return tool_; }
  [[nodiscard]] Tool& tool() noexcept { return tool_; }
  /// Signal health of the spindle, or of an axis.
  [[nodiscard]] const SignalHealthMonitor<Real>& spindle_health() const noexcept {
    return spindle_.health;
  }
  [[nodiscard]] const SignalHealthMonitor<Real>& axis_health(std::size_t i) const noexcept {
    return axis_[i].health;
  }
  [[nodiscard]] std::uint64_t samples() const noexcept { return samples_; }

 private:
  // What a monitor listens to.
  struct Heard {
    Real value = 0;
    Quality quality = Quality::missing;
  };

  // Ordered so that what every sample needs stays together: an observer has a long, idle tail.
  struct Slot {
    bool present = false;
    bool shared = true;  // the monitor listens to the reported estimate
    Drive out;
    DriveInput<Real> input;
    SignalHealthMonitor<Real> health;
    Observer observer;
    Observer monitor_observer;

    void configure(const DriveSlotConfig& c) noexcept {
      present = c.present;
      if (!present) return;
      input.configure(c.input);
      health.configure(c.signal);
      observer.configure(c.observer);
      shared = c.observer.disturbance_cutoff_rad_s == c.monitor_observer.disturbance_cutoff_rad_s &&
               c.observer.velocity_cutoff_rad_s == c.monitor_observer.velocity_cutoff_rad_s;
      monitor_observer.configure(c.monitor_observer);
    }
    void reset() noexcept {
      input.reset();
      health.reset();
      observer.reset();
      monitor_observer.reset();
      out = Drive{};
      out.signal = health.state().state;
    }
    Heard process(const RawDriveSample<Real>& raw) noexcept {
      // Almost every sample is a sound one; the other way gives the same result.
      if (!input.process(raw, out.sample)) return process_in_full();
      health.process(out.sample);
      out.estimate = observer.advance(out.sample);
      out.quality = observer.state().quality;
      if (shared) return {out.estimate, out.quality};
      const Real listened = monitor_observer.advance(out.sample);
      return {listened, monitor_observer.state().quality};
    }
    [[gnu::noinline]] Heard process_in_full() noexcept {
      health.process(out.sample);
      out.estimate = observer.process(out.sample);
      out.quality = observer.state().quality;
      if (shared) return {out.estimate, out.quality};
      const Real listened = monitor_observer.process(out.sample);
      return {listened, monitor_observer.state().quality};
    }
  };

  static Status validate_slot(const DriveSlotConfig& c) noexcept {
    if (const Status s = DriveInput<Real>::validate(c.input); !s.ok()) return s;
    if (const Status s = SignalHealthMonitor<Real>::validate(c.signal); !s.ok()) return s;
    if (const Status s = Observer::validate(c.observer); !s.ok()) return s;
    return Observer::validate(c.monitor_observer);
  }

  [[gnu::noinline]] void report_chatter(MonitorState state) noexcept {
    const auto& chatter = chatter_.chatter_alarm();
    const auto& forced = chatter_.forced_alarm();
    const bool is_forced = forced.state().state == state && chatter.state().state != state;
    StateChange<Real>& change = report(spindle_, MonitorId::chatter, Channel::spindle, state);
    change.value = is_forced ? chatter_.state().forced_Nm2 : chatter_.state().chatter_Nm2;
    change.threshold = is_forced ? forced.threshold() : chatter.threshold();
    change.detail = is_forced ? 1 : 0;
  }

  [[gnu::noinline]] void tell_chatter() noexcept {
    std::array<Real, kAxes> position_m{};
    bool known = false;
    for (std::size_t i = 0; i < kAxes; ++i) {
      if (!axis_[i].present) continue;
      position_m[i] = axis_[i].out.sample.position;
      known = true;
    }
    if (known) chatter_.tell_position(position_m);
  }

  [[gnu::noinline]] void report_collision(std::size_t i, MonitorState state) noexcept {
    // The alarm hears every phase of motion in terms of one threshold; said in its own terms.
    const auto& alarm = collision_[i].alarm();
    StateChange<Real>& change = report(axis_[i], MonitorId::collision, axis_channel(i), state);
    change.threshold = collision_[i].threshold_N_per_s();
    change.value = alarm.threshold() > 0
                       ? alarm.state().value * (change.threshold / alarm.threshold())
                       : alarm.state().value;
    change.detail = 0;
  }

  [[gnu::noinline]] void report_signal(Slot& slot, Channel channel) noexcept {
    const auto& health = slot.health.state();
    changes_[change_count_++] = {MonitorId::signal,
                                 channel,
                                 health.state,
                                 slot.out.signal,
                                 health.share,
                                 slot.health.threshold(),
                                 static_cast<std::uint8_t>(health.cause)};
    slot.out.signal = health.state;
  }

  [[gnu::noinline]] void watch_tool(Heard torque) noexcept {
    const auto changed = [this](MonitorId monitor, MonitorState before, MonitorState state,
                                Real value, Real threshold, std::uint8_t detail) noexcept {
      report_tool({monitor, Channel::tool, state, before, value, threshold, detail});
    };
    const DriveSample<Real>& spindle = spindle_.out.sample;
    ToolSample<Real> in;
    in.torque_Nm = torque.value;
    in.turn_angle_rad = spindle.turn_angle_rad;
    in.increment_rad = spindle.increment;
    in.spindle = torque.quality;
    if (!half_rate_) {
      if (lateral_on_) {
        in.force_x_N = lateral_[0].process(axis_[0].out.sample);
        in.force_y_N = lateral_[1].process(axis_[1].out.sample);
        in.lateral = lateral_[0].state().quality | lateral_[1].state().quality;
      }
      tool_.hear_spindle(in, changed);
      hear_thrust(in);
      tool_.hear_lateral(in, changed);
      tool_.hear_thrust(in, changed);
      return;
    }
    tool_.hear_spindle(in, changed);
    // The others take turns, and hear of two samples as of one.
    in.increment_rad += last_spindle_.increment;
    in.spindle |= last_spindle_.quality;
    last_spindle_ = {spindle.increment, torque.quality};
    if (samples_ % 2 == 0) {
      hear_thrust(in);
      in.feed_m += last_thrust_.increment;
      in.thrust |= last_thrust_.quality;
      tool_.hear_thrust(in, changed);
      for (std::size_t i = 0; i < lateral_.size(); ++i) {
        const DriveSample<Real>& now = axis_[i].out.sample;
        last_lateral_[i] = {now.increment, now.effort, now.quality};
      }
    } else {
      hear_thrust(in);
      last_thrust_ = {in.feed_m, in.thrust};
      if (lateral_on_) {
        in.force_x_N = lateral_[0].process(pair(0));
        in.force_y_N = lateral_[1].process(pair(1));
        in.lateral = lateral_[0].state().quality | lateral_[1].state().quality;
      }
      tool_.hear_lateral(in, changed);
    }
  }

  // The last two samples of an axis as one.
  [[nodiscard]] DriveSample<Real> pair(std::size_t i) const noexcept {
    const DriveSample<Real>& now = axis_[i].out.sample;
    const LateralPast& last = last_lateral_[i];
    return {now.increment + last.increment, now.position, now.turn_angle_rad,
            Real(0.5) * (now.effort + last.effort), now.quality | last.quality};
  }

  void hear_thrust(ToolSample<Real>& in) const noexcept {
    in.level_torque_Nm = spindle_.out.estimate;
    // Sine and cosine are formed there already.
    const auto& heard = chatter_.state();
    if (heard.last.angle_rad == in.turn_angle_rad) in.turn = &heard.last_turn;
    if (!axis_[2].present) return;
    in.thrust_N = axis_[2].out.estimate;
    in.feed_m = axis_[2].out.sample.increment;
    in.thrust = axis_[2].out.quality;
  }

  [[gnu::noinline]] void report_tool(const StateChange<Real>& change) noexcept {
    changes_[change_count_++] = change;
  }

  StateChange<Real>& report(Slot& slot, MonitorId monitor, Channel channel,
                            MonitorState state) noexcept {
    StateChange<Real>& change = changes_[change_count_++];
    change.monitor = monitor;
    change.channel = channel;
    change.before = slot.out.state;
    change.state = slot.out.state = state;
    return change;
  }

  Slot spindle_;
  std::array<Slot, kAxes> axis_;
  Chatter chatter_;
  std::array<Collision, kAxes> collision_;
  CutDetector<Real> cut_;
  std::array<Observer, 2> lateral_;  // of x and y, for the tool
  bool tool_on_ = false;
  bool lateral_on_ = false;
  bool half_rate_ = false;
  // Of the sample before, for those that hear of two at once.
  struct Past {
    Real increment = 0;
    Quality quality = Quality::good;
  };
  Past last_spindle_;
  Past last_thrust_;
  struct LateralPast {
    Real increment = 0;
    Real effort = 0;
    Quality quality = Quality::good;
  };
  std::array<LateralPast, 2> last_lateral_{};
  [[no_unique_address]] Tool tool_;
  std::array<StateChange<Real>, kMaxChanges> changes_{};
  std::size_t change_count_ = 0;
  std::uint64_t samples_ = 0;
};

}  // namespace servosense
