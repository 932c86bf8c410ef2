// The monitor stack: every monitor on one sample.
//
// Purpose: spindle and up to three feed axes, from raw drive signals to states and alarms, once per
// servo period. Each drive: input conditioning, the observer whose estimate is reported, and the
// observer of its monitor where that one needs other cutoffs (Koike 2016, table 3-3: 335 rad/s for
// collision, 3500 rad/s for chatter). The spindle feeds the chatter monitor, each axis a collision
// monitor.
// Delay: that of the observers and monitors. Cost: bench/firmware/instructions.csv (monitor_stack).
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
  DisturbanceObserverConfig observer;  ///< of the reported estimate
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
      const Real torque = spindle_.process(in.spindle);
      const DriveSample<Real>& s = spindle_.out.sample;
      report(spindle_, MonitorId::chatter, Channel::spindle,
             chatter_.process(torque, s.turn_angle_rad, s.increment, spindle_.monitor_quality));
    }
    for (std::size_t i = 0; i < kAxes; ++i) {
      if (!axis_[i].present) continue;
      const Real force = axis_[i].process(in.axis[i]);
      report(axis_[i], MonitorId::collision, axis_channel(i),
             collision_[i].process(force, axis_[i].monitor_quality));
    }
    return {changes_.data(), change_count_};
  }

  [[nodiscard]] const Drive& spindle() const noexcept { return spindle_.out; }
  [[nodiscard]] const Drive& axis(std::size_t i) const noexcept { return axis_[i].out; }
  [[nodiscard]] const Chatter& chatter() const noexcept { return chatter_; }
  [[nodiscard]] const Collision& collision(std::size_t i) const noexcept { return collision_[i]; }
  [[nodiscard]] std::uint64_t samples() const noexcept { return samples_; }

 private:
  struct Slot {
    bool present = false;
    bool shared = true;  // the monitor listens to the reported estimate
    DriveInput<Real> input;
    Observer observer;
    Observer monitor_observer;
    Quality monitor_quality = Quality::settling;
    Drive out;

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
    // Returns the estimate that the monitor listens to.
    Real process(const RawDriveSample<Real>& raw) noexcept {
      out.sample = input.process(raw);
      out.estimate = observer.process(out.sample);
      out.quality = monitor_quality = observer.state().quality;
      if (shared) return out.estimate;
      const Real listened = monitor_observer.process(out.sample);
      monitor_quality = monitor_observer.state().quality;
      return listened;
    }
  };

  static Status validate_slot(const DriveSlotConfig& c) noexcept {
    if (const Status s = DriveInput<Real>::validate(c.input); !s.ok()) return s;
    if (const Status s = Observer::validate(c.observer); !s.ok()) return s;
    return Observer::validate(c.monitor_observer);
  }

  void report(Slot& slot, MonitorId monitor, Channel channel, MonitorState state) noexcept {
    const MonitorState before = slot.out.state;
    if (state == before) return;
    slot.out.state = state;
    StateChange<Real>& change = changes_[change_count_++];
    change.monitor = monitor;
    change.channel = channel;
    change.state = state;
    change.before = before;
    if (monitor == MonitorId::chatter) {
      // Chatter is the graver; what it does not account for is forced vibration.
      const bool forced =
          state == MonitorState::warning && chatter_.chatter_alarm().state().state != state;
      change.value = forced ? chatter_.state().forced_Nm2 : chatter_.state().chatter_Nm2;
      change.threshold = forced ? chatter_.forced_alarm().threshold() : chatter_.chatter_alarm().threshold();
      change.forced = forced;
    } else {
      const Collision& c = collision_[static_cast<std::size_t>(channel) -
                                      static_cast<std::size_t>(Channel::x)];
      change.value = c.alarm().state().value;
      change.threshold = c.alarm().threshold();
    }
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
