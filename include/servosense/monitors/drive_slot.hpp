// One drive of the monitor stack: from its raw samples to what its monitor listens to.
//
// Purpose: input conditioning, signal health, the observer whose estimate is reported and that of
// the monitor, on every sample or on groups of them (mean effort, summed motion, the faults of
// all). Delay, cost, range, bounds: those of the blocks; a mean lies half a group earlier.
#pragma once

#include "servosense/core/drive_input.hpp"
#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/monitor_stack_config.hpp"
#include "servosense/monitors/signal_health.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

// Ordered so that what every sample needs stays together: an observer has a long, idle tail.
template <RealNumber Real>
struct DriveSlot {
  using Observer = DisturbanceObserver<Real>;

  /// Everything of one drive that telemetry reads.
  struct Drive {
    DriveSample<Real> sample;
    Real estimate = 0;  ///< cutting torque [Nm] or force [N]
    Quality quality = Quality::settling;
    MonitorState state = MonitorState::idle;           ///< of chatter or collision
    MonitorState signal = MonitorState::signal_fault;  ///< until it is configured
  };

  // What a monitor listens to.
  struct Heard {
    Real value = 0;
    Quality quality = Quality::missing;
  };

  // Samples that are heard of as of one, but for the last.
  struct Group {
    Real increment = 0;
    Real effort = 0;  // sum
    Quality quality = Quality::good;
    bool sound = true;  // what the input has not kept to itself is nil

    // `already`: samples there are. Before a restart lies another life: nothing of it may be
    // added, nor its gap hide the restart.
    void add(const DriveSample<Real>& in, unsigned already) noexcept {
      sound = false;
      if (has(in.quality, Quality::restarted)) {
        increment = 0;
        effort = static_cast<Real>(already) * in.effort;
        quality = Quality::good;
      }
      increment += in.increment;
      effort += in.effort;
      quality |= in.quality;
    }
  };

  /// A monitor that has stood down is said to be armed again half a second later at the earliest,
  /// so that faults that come and go do not drown what matters.
  struct Told {
    std::uint32_t since = 0;
    bool down = false;

    [[nodiscard]] bool puts_off(MonitorState now, std::uint32_t sample,
                                std::uint32_t patience) noexcept {
      const bool raised = now == MonitorState::alarm || now == MonitorState::warning;
      if (raised || sample - since >= patience) down = false;
      return down;
    }
    void tell(MonitorState was, MonitorState now, std::uint32_t sample) noexcept {
      const bool watched = was >= MonitorState::armed && was <= MonitorState::alarm;
      if (now == MonitorState::signal_fault || (watched && now == MonitorState::learning)) {
        down = true;
        since = sample;
      }
    }
  };

  bool present = false;
  bool shared = true;  // the monitor listens to the reported estimate
  bool grouped = false;
  unsigned before = 0;  // samples of a group but for the last
  Real share = 1;       // of one in its group
  Group group;
  Told told;
  Drive out;
  DriveInput<Real> input;
  SignalHealthMonitor<Real> health;
  Observer observer;
  Observer monitor_observer;

  void configure(const DriveSlotConfig& c, unsigned samples) noexcept {
    present = c.present;
    grouped = samples > 1;
    before = samples - 1;
    share = Real(1) / static_cast<Real>(samples);
    if (!present) return;
    DriveInputConfig raw = c.input;
    raw.group = samples;
    input.configure(raw);
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
    group = {};
    told = {};
  }
  /// A sample; in groups, the last of one. Almost every one is sound; the other way gives the
  /// same result.
  template <bool Grouped>
  [[gnu::always_inline]] Heard hear(const RawDriveSample<Real>& raw) noexcept {
    DriveSample<Real>& in = out.sample;
    const bool sound = Grouped ? input.process_last(raw, in) : input.process(raw, in);
    if (!sound || (Grouped && !group.sound)) return hear_in_full();
    health.process(in);
    if constexpr (Grouped) {
      in.effort = share * (group.effort + in.effort);
      in.quality |= group.quality;
      group.effort = 0;
      group.quality = Quality::good;
    }
    out.estimate = Grouped ? observer.advance_mean(in) : observer.advance(in);
    out.quality = observer.state().quality;
    if (health.distrusted())
      return distrust(Grouped ? monitor_observer.advance_mean(in) : monitor_observer.advance(in));
    if (shared) return {out.estimate, out.quality};
    const Real listened =
        Grouped ? monitor_observer.advance_mean(in) : monitor_observer.advance(in);
    return {listened, monitor_observer.state().quality};
  }
  [[gnu::noinline]] Heard hear_in_full() noexcept {
    DriveSample<Real>& in = out.sample;
    health.process(in);
    if (grouped) {
      group.add(in, before);
      in.increment = group.increment;
      in.effort = share * group.effort;
      in.quality = group.quality;
      group = {};
    }
    out.estimate = observer.process(in);
    out.quality = observer.state().quality;
    if (shared && !health.distrusted()) return {out.estimate, out.quality};
    const Real listened = monitor_observer.process(in);
    if (health.distrusted()) return distrust(listened);
    return {listened, monitor_observer.state().quality};
  }
  // Observers go on, what listens to them stands down.
  [[gnu::noinline]] Heard distrust(Real listened) noexcept {
    out.quality |= Quality::gap;
    return {listened, monitor_observer.state().quality | Quality::gap};
  }
  /// A sample that does not complete its group; `turn` modulo the group's length is what has gone
  /// before it. True when the signal's health has changed.
  [[gnu::noinline]] bool put_by(const RawDriveSample<Real>& raw, unsigned turn) noexcept {
    DriveSample<Real>& in = out.sample;
    if (!input.put_by(raw, in)) return put_by_in_full(turn);
    health.process(in);
    group.effort += in.effort;
    group.quality |= in.quality;
    return health.state().state != out.signal;
  }
  [[gnu::noinline]] bool put_by_in_full(unsigned turn) noexcept {
    DriveSample<Real>& in = out.sample;
    health.process(in);
    group.add(in, turn & before);
    if (has(in.quality, kUnusable | Quality::gap)) out.quality |= in.quality;
    return health.state().state != out.signal;
  }
};

}  // namespace servosense
