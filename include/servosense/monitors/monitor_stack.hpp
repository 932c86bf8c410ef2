// The monitor stack: every monitor on one sample.
//
// Purpose: spindle and up to three feed axes, from raw drive signals to states and alarms, once per
// servo period. Each drive: input conditioning, the observer whose estimate is reported, and the
// observer of its monitor where that one needs other cutoffs (Koike 2016, table 3-3: 335 rad/s for
// collision, 3500 rad/s for chatter). The spindle feeds the chatter monitor, each axis a collision
// monitor.
// Delay: that of the observers and monitors. Cost on Cortex-M4F: 1217 instructions in the
// mean of the bench signal, 2424 for its worst sample; 1577 and 2920 with two observers a drive.
// Memory: the whole stack is one object without heap. Revolutions and Harmonics size the chatter
// monitor; KeptSamples, 12 bytes each in float, are what a chatter alarm is replayed from.
// Range and numerical bound: those of the blocks. Bad at: sums over drives (each is watched alone).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "servosense/core/channel.hpp"
#include "servosense/core/drive_sample.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/core/status.hpp"
#include "servosense/monitors/chatter.hpp"
#include "servosense/monitors/collision.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

/// One drive of the stack.
struct DriveSlotConfig {
  bool present = false;
  DriveInputConfig input;
  DisturbanceObserverConfig observer;          ///< of the reported estimate
  DisturbanceObserverConfig monitor_observer;  ///< of the monitor; equal cutoffs share one observer
};

struct SpindleSlotConfig : DriveSlotConfig {
  ChatterConfig chatter;
};

struct AxisSlotConfig : DriveSlotConfig {
  CollisionConfig collision;
};

struct MonitorStackConfig {
  SpindleSlotConfig spindle;
  std::array<AxisSlotConfig, kAxes> axis;
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
  bool forced = false;  ///< chatter monitor: forced vibration, not chatter
};

template <RealNumber Real, std::size_t Revolutions = 8, std::size_t Harmonics = 10,
          std::size_t KeptSamples = 1024>
class MonitorStack {
 public:
  using Config = MonitorStackConfig;
  using Chatter = ChatterMonitor<Real, Revolutions, Harmonics, KeptSamples>;
  using Collision = CollisionMonitor<Real>;
  using Observer = DisturbanceObserver<Real>;
  static constexpr std::size_t kMaxChanges = 1 + kAxes;

  /// Everything of one drive that telemetry reads.
  struct Drive {
    DriveSample<Real> sample;
    Real estimate = 0;  ///< cutting torque [Nm] or force [N]
    Quality quality = Quality::settling;
    MonitorState state = MonitorState::idle;
  };

  static Status validate(const Config& c) noexcept {
    if (c.spindle.present) {
      if (const Status s = validate_slot(c.spindle); !s.ok()) return s;
      if (const Status s = Chatter::validate(c.spindle.chatter); !s.ok()) return s;
    }
    for (const AxisSlotConfig& axis : c.axis) {
      if (!axis.present) continue;
      if (const Status s = validate_slot(axis); !s.ok()) return s;
      if (const Status s = Collision::validate(axis.collision); !s.ok()) return s;
    }
    return {};
  }

  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    spindle_.configure(c.spindle);
    if (c.spindle.present) chatter_.configure(c.spindle.chatter);
    for (std::size_t i = 0; i < kAxes; ++i) {
      axis_[i].configure(c.axis[i]);
      if (c.axis[i].present) collision_[i].configure(c.axis[i].collision);
    }
    reset();
  }

  void reset() noexcept {
    spindle_.reset();
    chatter_.reset();
    for (std::size_t i = 0; i < kAxes; ++i) {
      axis_[i].reset();
      collision_[i].reset();
    }
    change_count_ = 0;
    samples_ = 0;
  }

  /// One servo period. Returns the monitors whose state changed; valid until the next call.
  std::span<const StateChange<Real>> process(const ServoSample<Real>& in) SERVOSENSE_NONBLOCKING {
    change_count_ = 0;
    ++samples_;
    if (spindle_.present) {
      const Heard torque = spindle_.process(in.spindle);
      const DriveSample<Real>& s = spindle_.out.sample;
      const MonitorState state =
          chatter_.process(torque.value, s.turn_angle_rad, s.increment, torque.quality);
      if (state != spindle_.out.state) report_chatter(state);
    }
    for (std::size_t i = 0; i < kAxes; ++i) {
      if (!axis_[i].present) continue;
      const Heard force = axis_[i].process(in.axis[i]);
      const MonitorState state = collision_[i].process(force.value, force.quality);
      if (state != axis_[i].out.state) report_collision(i, state);
    }
    return {changes_.data(), change_count_};
  }

  [[nodiscard]] const Drive& spindle() const noexcept { return spindle_.out; }
  [[nodiscard]] const Drive& axis(std::size_t i) const noexcept { return axis_[i].out; }
  [[nodiscard]] const Chatter& chatter() const noexcept { return chatter_; }
  [[nodiscard]] const Collision& collision(std::size_t i) const noexcept { return collision_[i]; }
  [[nodiscard]] std::uint64_t samples() const noexcept { return samples_; }

 private:
  // What a monitor listens to.
  struct Heard {
    Real value;
    Quality quality;
  };

  // Ordered so that what every sample needs stays together: an observer has a long, idle tail.
  struct Slot {
    bool present = false;
    bool shared = true;  // the monitor listens to the reported estimate
    Drive out;
    DriveInput<Real> input;
    Observer observer;
    Observer monitor_observer;

    void configure(const DriveSlotConfig& c) noexcept {
      present = c.present;
      if (!present) return;
      input.configure(c.input);
      observer.configure(c.observer);
      shared = c.observer.disturbance_cutoff_rad_s == c.monitor_observer.disturbance_cutoff_rad_s &&
               c.observer.velocity_cutoff_rad_s == c.monitor_observer.velocity_cutoff_rad_s;
      monitor_observer.configure(c.monitor_observer);
    }
    void reset() noexcept {
      input.reset();
      observer.reset();
      monitor_observer.reset();
      out = Drive{};
    }
    Heard process(const RawDriveSample<Real>& raw) noexcept {
      input.process(raw, out.sample);
      out.estimate = observer.process(out.sample);
      out.quality = observer.state().quality;
      if (shared) return {out.estimate, out.quality};
      const Real listened = monitor_observer.process(out.sample);
      return {listened, monitor_observer.state().quality};
    }
  };

  static Status validate_slot(const DriveSlotConfig& c) noexcept {
    if (const Status s = DriveInput<Real>::validate(c.input); !s.ok()) return s;
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
    change.forced = is_forced;
  }

  [[gnu::noinline]] void report_collision(std::size_t i, MonitorState state) noexcept {
    const auto& alarm = collision_[i].alarm();
    StateChange<Real>& change = report(axis_[i], MonitorId::collision, axis_channel(i), state);
    change.value = alarm.state().value;
    change.threshold = alarm.threshold();
    change.forced = false;
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
  std::array<StateChange<Real>, kMaxChanges> changes_{};
  std::size_t change_count_ = 0;
  std::uint64_t samples_ = 0;
};

}  // namespace servosense
