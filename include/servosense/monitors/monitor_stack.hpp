// The monitor stack: every monitor on one sample.
//
// Purpose: spindle and up to three feed axes (six on hosts), from raw drive signals to states and
// alarms, once per servo period. Each drive: input conditioning, the observer whose estimate is
// reported, and the observer of its monitor where that one needs other cutoffs (Koike 2016, table
// 3-3: 335 rad/s for collision, 3500 rad/s for chatter). The spindle feeds the chatter monitor,
// each axis a collision monitor, every drive a signal health monitor, all of them together the
// monitors of the tool. Delay: that of the observers and monitors. Cost on Cortex-M4F:
// bench/firmware/instructions.csv, the rows monitor_stack, monitor_stack_two_observers and, with
// all of the tool, monitor_stack_tool; `_grouped` with samples heard of in groups. Memory: the
// whole stack is one object without heap. Revolutions and Harmonics size the chatter monitor;
// KeptSamples, 12 bytes each in float, are what a chatter alarm is replayed from; Teeth is the
// capacity of the breakage monitors, 0 leaves the monitors of the tool out altogether. Range and
// numerical bound: those of the blocks. Bad at: sums over drives (each is watched alone).
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "servosense/core/channel.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/whole.hpp"
#include "servosense/monitors/chatter.hpp"
#include "servosense/monitors/collision.hpp"
#include "servosense/monitors/cut_detector.hpp"
#include "servosense/monitors/drive_slot.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/monitor_stack_config.hpp"
#include "servosense/monitors/signal_health.hpp"
#include "servosense/monitors/tool_monitors.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

/// A monitor whose state changed on this sample.
template <RealNumber Real>
struct StateChange {
  MonitorId monitor = MonitorId::signal;
  Channel channel = Channel::machine;
  MonitorState state = MonitorState::idle;
  MonitorState before = MonitorState::idle;
  Real value = 0;
  Real threshold = 0;
  /// chatter: ChatterSign; tooth-breakage: 1 = a pattern that lasts; wear: WearRule;
  /// torque-band: code of the TorqueCause of an alarm; signal: SignalCause.
  std::uint8_t detail = 0;
  std::uint64_t faulty = 0;  ///< signal: faulty samples of the drive since the start
  /// Breakage: the chatter monitor leaves the step of the torque to this one.
  bool steps = false;
  Real frequency_hz = 0;  ///< chatter, of a line: of the torque; else 0
  Real error_hz = 0;      ///< standard error of that
};

template <RealNumber Real, std::size_t Revolutions = 8, std::size_t Harmonics = 10,
          std::size_t KeptSamples = 1024, std::size_t Teeth = 8, std::size_t Axes = kAxes>
class MonitorStack {
  struct NoTool {
    static constexpr std::array<MonitorId, 0> kIds{};
    static Status validate(const ToolMonitorsConfig&) noexcept { return {}; }
    void configure(const ToolMonitorsConfig&) noexcept {}
    void reset() noexcept {}
    [[nodiscard]] static bool any() noexcept { return false; }
  };

 public:
  static_assert(Axes >= kAxes, "tool and chatter hear of x, y and z");
  using Config = MonitorStackConfigWith<DisturbanceObserverView, Axes>;
  using Chatter = ChatterMonitor<Real, Revolutions, Harmonics, KeptSamples>;
  using Collision = CollisionMonitor<Real>;
  using Observer = DisturbanceObserver<Real>;
  using Tool = std::conditional_t<(Teeth > 0), ToolMonitors<Real, (Teeth > 0 ? Teeth : 2)>, NoTool>;
  using Slot = DriveSlot<Real>;
  using Drive = typename Slot::Drive;
  /// What watches a drive: one of the spindle or one of an axis, and its signal.
  static constexpr auto kSpindleMonitors = std::to_array({MonitorId::chatter, MonitorId::signal});
  static constexpr auto kAxisMonitors = std::to_array({MonitorId::collision, MonitorId::signal});
  static constexpr auto& kToolMonitors = Tool::kIds;
  /// Samples that are heard as one, of a stack in groups.
  static constexpr unsigned kSpindleGroup = 2;
  static constexpr unsigned kAxisGroup = 4;
  /// In one sample each of them changes at most once.
  static constexpr std::size_t kMaxChanges =
      kSpindleMonitors.size() + Axes * kAxisMonitors.size() + kToolMonitors.size();

  /// Refuses what no block accepts, and a stack that could not alarm (monitor_stack_config.hpp).
  static Status validate(const HostStackConfig& c) noexcept {
    for (std::size_t i = Axes; i < kAllAxes; ++i)
      if (c.axis[i].present)
        return Status::invalid("present", "must be of an axis that this stack has room for");
    return validate(view_of<Axes>(c));
  }
  static Status validate(const Config& c) noexcept {
    bool any = c.spindle.present;
    for (const AxisSlotConfig& axis : c.axis) any = any || axis.present;
    if (!any) return Status::invalid("present", "must be set of one drive at least");
    if (c.spindle.present) {
      if (const Status s = validate_slot(c.spindle); !s.ok()) return s;
      if (const Status s = Chatter::validate(c.spindle.chatter); !s.ok()) return s;
      if (const Status s = CutDetector<Real>::validate(c.cut); !s.ok()) return s;
      if (c.spindle.chatter_on) {
        if (const Status s = validate_model(c.spindle); !s.ok()) return s;
        if (!(c.spindle.chatter.chatter_threshold_Nm2 > 0 ||
              c.spindle.chatter.forced_threshold_Nm2 > 0))
          return Status::invalid("chatter_threshold_Nm2",
                                 "must be positive, or chatter_on false: it could not alarm");
      }
    }
    for (std::size_t i = 0; i < Axes; ++i) {
      const auto& axis = c.axis[i];
      if (!axis.present) continue;
      if (const Status s = validate_slot(axis); !s.ok()) return s;
      if (const Status s = Collision::validate(axis.collision); !s.ok()) return s;
      if (!axis.collision_on) continue;
      if (const Status s = validate_model(axis); !s.ok()) return s;
      // Those behind z turn.
      if (!(axis.input.unit_per_turn <= (i < kAxes ? kLongestLead_m : kTwoPi)))
        return Status::invalid("unit_per_turn", "must be the lead in metres, at most 1");
      if (!(axis.collision.threshold_N_per_s > 0))
        return Status::invalid("threshold_N_per_s",
                               "must be positive, or collision_on false: it could not alarm");
    }
    if (c.grouped && c.tool.half_rate)
      return Status::invalid("half_rate", "must be off in groups, which do more");
    if (c.grouped && c.tool.tooth_breakage_on && !c.tool.tooth_breakage.torque)
      return Status::invalid("grouped", "must be off with tooth breakage on x and y");
    if (const Status s = Tool::validate(c.tool); !s.ok()) return s;
    if (c.tool.needs_lateral_forces())
      for (std::size_t i = 0; i < 2; ++i)
        if (const Status s = Observer::validate(c.axis[i].tool_observer); !s.ok()) return s;
    return {};
  }

  /// Requires validate(c).ok().
  void configure(const HostStackConfig& c) noexcept { configure(view_of<Axes>(c)); }
  void configure(const Config& c) noexcept {
    grouped_ = c.grouped;
    configured_ = true;
    spindle_.configure(c.spindle, grouped_ ? kSpindleGroup : 1);
    if (c.spindle.present) chatter_.configure(c.spindle.chatter);
    cut_.configure(c.cut);
    for (std::size_t i = 0; i < Axes; ++i) {
      axis_[i].configure(c.axis[i], grouped_ ? kAxisGroup : 1);
      if (c.axis[i].present) collision_[i].configure(c.axis[i].collision);
    }
    tool_.configure(c.tool);
    double period_s = c.spindle.input.sample_period_s;
    for (const AxisSlotConfig& axis : c.axis)
      if (axis.present) period_s = axis.input.sample_period_s;
    patience_ = nearest_whole(0.5 / period_s);
    tool_on_ = tool_.any();
    half_rate_ = c.tool.half_rate;
    lateral_on_ = Teeth > 0 && c.tool.needs_lateral_forces();
    over_path_ = Teeth > 0 && c.tool.torque_band_on && c.tool.torque_band.over_path;
    expects_ = Teeth > 0 && c.tool.torque_band_on && c.tool.torque_band.has_cuts;
    if (lateral_on_)
      for (std::size_t i = 0; i < lateral_.size(); ++i)
        lateral_[i].configure(c.axis[i].tool_observer);
    reset();
  }

  void reset() noexcept {
    spindle_.reset();
    chatter_.reset();
    cut_.reset();
    for (std::size_t i = 0; i < Axes; ++i) {
      axis_[i].reset();
      axis_[i].input.stagger(static_cast<std::uint32_t>(i + 1), Axes + 1);
      collision_[i].reset();
      collision_[i].stagger(
          static_cast<std::uint32_t>(i % kAxes * Collision::kEvidenceStride / kAxes));
    }
    tool_.reset();
    for (Observer& observer : lateral_) observer.reset();
    last_lateral_ = {};
    way_m_ = {};
    last_spindle_ = last_thrust_ = {};
    torque_ = {};
    change_count_ = 0;
    samples_ = 0;
    tool_told_ = {};
    tool_sample_ = {};
    tool_waits_ = false;
    expected_cut_ = nullptr;
  }

  /// One servo period. Returns the monitors whose state changed; valid until the next call. Before
  /// configure() that is always one: a signal fault of the machine. Of a sample of fewer axes the
  /// others hear nothing.
  template <std::size_t N>
  std::span<const StateChange<Real>> process(const ServoSample<Real, N>& in)
      SERVOSENSE_NONBLOCKING {
    static_assert(N <= Axes);
    change_count_ = 0;
    ++samples_;
    machine_ = {in.t_ns, in.nc_block, in.feed_override};
    if (grouped_)
      hear_in_turns(in);
    else
      hear_all(in);
    return {changes_.data(), change_count_};
  }

  /// Friction of the spindle that has changed since configure() (observer/friction_follower.hpp).
  void set_spindle_friction(Real viscous, Real coulomb) noexcept {
    spindle_.observer.set_friction(viscous, coulomb);
    spindle_.monitor_observer.set_friction(viscous, coulomb);
  }

  /// Whether the period just heard has gone to the blocks of a drive: in groups, the last of each.
  [[nodiscard]] bool spindle_heard() const noexcept {
    return !grouped_ || samples_ % kSpindleGroup == 0;
  }
  [[nodiscard]] bool axis_heard(std::size_t i) const noexcept {
    return !grouped_ || samples_ % kAxisGroup == turn_of(i);
  }
  /// Motion of the spindle in that period; in groups that of all with the last of them.
  [[nodiscard]] Real spindle_increment() const noexcept {
    return spindle_heard() ? spindle_.out.sample.increment : Real(0);
  }

  [[nodiscard]] const Drive& spindle() const noexcept { return spindle_.out; }
  [[nodiscard]] const Drive& axis(std::size_t i) const noexcept { return axis_[i].out; }
  /// Motion that the last sample has told of: in groups that of the whole group at once, and none
  /// between.
  [[nodiscard]] Real spindle_way() const noexcept {
    return !grouped_ || samples_ % kSpindleGroup == 0 ? spindle_.out.sample.increment : Real(0);
  }
  [[nodiscard]] Real axis_way(std::size_t i) const noexcept {
    return !grouped_ || samples_ % kAxisGroup == turn_of(i) ? axis_[i].out.sample.increment
                                                            : Real(0);
  }
  /// What the monitors of the spindle listened to last.
  [[nodiscard]] const typename Slot::Heard& heard_torque() const noexcept { return torque_; }
  [[nodiscard]] const Chatter& chatter() const noexcept { return chatter_; }
  [[nodiscard]] const Collision& collision(std::size_t i) const noexcept { return collision_[i]; }
  [[nodiscard]] const CutDetector<Real>& cut() const noexcept { return cut_; }
  [[nodiscard]] const Tool& tool() const noexcept { return tool_; }
  [[nodiscard]] Tool& tool() noexcept { return tool_; }
  /// What the program asks for; nullptr where that is not known.
  [[nodiscard]] const ExpectedCut<Real>* expected_cut() const noexcept { return expected_cut_; }
  /// Signal health of the spindle, or of an axis.
  [[nodiscard]] const SignalHealthMonitor<Real>& spindle_health() const noexcept {
    return spindle_.health;
  }
  [[nodiscard]] const SignalHealthMonitor<Real>& axis_health(std::size_t i) const noexcept {
    return axis_[i].health;
  }
  [[nodiscard]] std::uint64_t samples() const noexcept { return samples_; }

 private:
  using Heard = typename Slot::Heard;

  // What the sample before has left for those that hear of two at once.
  struct Past {
    Real increment = 0;
    Quality quality = Quality::good;
  };

  // Those of the tool follow each other in MonitorId: what is told of them is found by their place.
  static constexpr std::size_t kFirstOfTool = static_cast<std::size_t>(
      kToolMonitors.empty() ? MonitorId::chatter : *std::ranges::min_element(kToolMonitors));
  static_assert(
      [] {
        std::array<unsigned, kMonitorCount> watched{};
        for (const MonitorId id : kSpindleMonitors) ++watched[static_cast<std::size_t>(id)];
        for (const MonitorId id : kAxisMonitors) ++watched[static_cast<std::size_t>(id)];
        for (const MonitorId id : kToolMonitors) ++watched[static_cast<std::size_t>(id)];
        --watched[static_cast<std::size_t>(MonitorId::signal)];     // of every drive
        ++watched[static_cast<std::size_t>(MonitorId::reference)];  // of whole windows: no stack's
        ++watched[static_cast<std::size_t>(MonitorId::cutting_coefficients)];  // beside it
        return Teeth == 0 || std::ranges::all_of(watched, [](unsigned n) { return n == 1; });
      }(),
      "every MonitorId is of the spindle, of the axes or of the tool");
  static_assert(kToolMonitors.empty() ||
                    static_cast<std::size_t>(*std::ranges::max_element(kToolMonitors)) + 1 ==
                        kFirstOfTool + kToolMonitors.size(),
                "the monitors of the tool follow each other in MonitorId");
  static constexpr unsigned turn_of(std::size_t axis) noexcept {  // of four samples
    return axis % 2 == 0 ? 1 : 3;
  }

  static Status validate_slot(const DriveSlotConfig& c) noexcept {
    if (const Status s = DriveInput<Real>::validate(c.input); !s.ok()) return s;
    if (const Status s = SignalHealthMonitor<Real>::validate(c.signal); !s.ok()) return s;
    if (const Status s = Observer::validate(c.observer); !s.ok()) return s;
    return Observer::validate(c.monitor_observer);
  }
  static constexpr double kLongestLead_m = 1;
  // Without inertia every acceleration is a cut.
  static Status validate_model(const DriveSlotConfig& c) noexcept {
    if (c.observer.drive.inertia > 0 && c.monitor_observer.drive.inertia > 0) return {};
    return Status::invalid("inertia", "must be known where a monitor is on");
  }

  // Nothing may look like "no alarm" where nothing watches. Grouped is set by configure() alone.
  [[gnu::noinline]] void tell_unconfigured() noexcept {
    next_change() = {MonitorId::signal,
                     Channel::machine,
                     MonitorState::signal_fault,
                     MonitorState::signal_fault,
                     0,
                     0,
                     static_cast<std::uint8_t>(SignalCause::silent_bus),
                     0};
  }

  template <std::size_t N>
  [[gnu::noinline]] void hear_all(const ServoSample<Real, N>& in) noexcept {
    if (spindle_.present)
      hear_spindle<false>(in.spindle);
    else if (!configured_)
      return tell_unconfigured();
    for (std::size_t i = 0; i < N; ++i)
      if (axis_[i].present) report_axis(i, hear_axis<false>(i, in.axis[i]));
    if (chatter_.asks_position()) tell_chatter();
    if constexpr (Teeth > 0)
      if (tool_on_) watch_tool();
    if (tool_waits_) tell_waiting();
  }
  // In groups, so that no sample bears the work of all: the spindle on even samples, x and z on
  // every other odd one, y on those between.
  template <std::size_t N>
  [[gnu::noinline]] void hear_in_turns(const ServoSample<Real, N>& in) noexcept {
    const auto turn = static_cast<unsigned>(samples_);
    if (spindle_.present) {
      if (turn % 2 == 0)
        hear_spindle<true>(in.spindle);
      else if (spindle_.put_by(in.spindle, 0))
        report_signal(spindle_, Channel::spindle);
    }
    hear_in_turn(0, in.axis[0], turn);
    hear_in_turn(1, in.axis[1], turn);
    hear_in_turn(2, in.axis[2], turn);
    for (std::size_t i = kAxes; i < N; ++i) hear_in_turn(i, in.axis[i], turn);
    if (turn % 2 == 0 && chatter_.asks_position()) tell_chatter();
    if constexpr (Teeth > 0)
      if (tool_on_) watch_in_turns(turn % kAxisGroup);
    if (tool_waits_) tell_waiting();
  }
  [[gnu::always_inline]] void hear_in_turn(std::size_t i, const RawDriveSample<Real>& raw,
                                           unsigned turn) noexcept {
    if (!axis_[i].present) return;
    Slot& axis = axis_[i];
    if (turn % kAxisGroup != turn_of(i)) {
      if (axis.put_by(raw, turn - turn_of(i) - 1)) report_signal(axis, axis_channel(i));
      return;
    }
    const MonitorState state = hear_group(i, raw);
    report_axis(i, state);
    if (i < lateral_.size() && lateral_on_) lateral_[i].process(axis.out.sample);
  }
  [[gnu::always_inline]] void report_axis(std::size_t i, MonitorState state) noexcept {
    Slot& axis = axis_[i];
    if (axis.health.state().state != axis.out.signal) report_signal(axis, axis_channel(i));
    if (state != axis.out.state) report_collision(i, state);
  }
  template <bool Grouped>
  [[gnu::always_inline]] MonitorState hear_axis(std::size_t i,
                                                const RawDriveSample<Real>& raw) noexcept {
    Slot& axis = axis_[i];
    const Heard force = axis.template hear<Grouped>(raw);
    const auto& cut = cut_.state();
    const bool expected = expected_cut_ != nullptr && i < kAxes;
    return collision_[i].process(force.value, axis.out.sample.increment, force.quality, cut.cut,
                                 cut.torque_Nm, cut.load_Nm,
                                 expected ? &expected_force_[i] : nullptr);
  }
  [[gnu::noinline]] MonitorState hear_group(std::size_t i,
                                            const RawDriveSample<Real>& raw) noexcept {
    return hear_axis<true>(i, raw);
  }
  template <bool Grouped>
  [[gnu::always_inline]] void hear_spindle(const RawDriveSample<Real>& raw) noexcept {
    if constexpr (Grouped) last_spindle_ = {spindle_.out.sample.increment, torque_.quality};
    const Heard torque = spindle_.template hear<Grouped>(raw);
    if (spindle_.health.state().state != spindle_.out.signal)
      report_signal(spindle_, Channel::spindle);
    const DriveSample<Real>& heard = spindle_.out.sample;
    const MonitorState state =
        chatter_.process(torque.value, heard.turn_angle_rad, heard.increment, torque.quality);
    if (state != spindle_.out.state) report_chatter(state);
    cut_.process(torque.value, heard.increment, torque.quality);
    torque_ = torque;
  }
  [[gnu::noinline]] void report_chatter(MonitorState state) noexcept {
    if (puts_off(spindle_.told, state)) return;
    const ChatterSign sign = chatter_.sign();
    StateChange<Real>& change = report(spindle_, MonitorId::chatter, Channel::spindle, state);
    change.detail = static_cast<std::uint8_t>(sign);
    change.value = chatter_.value(sign);
    change.threshold = chatter_.alarm(sign).threshold();
    if (sign != ChatterSign::line) return;
    change.frequency_hz = chatter_.lines().state().found.frequency_hz;
    change.error_hz = chatter_.lines().state().found.error_hz;
  }

  [[gnu::noinline]] void tell_chatter() noexcept {
    std::array<Real, kAxes> position_m{};
    bool known = false;
    for (std::size_t i = 0; i < kAxes; ++i) {
      if (!axis_[i].present) continue;
      position_m[i] = axis_[i].out.sample.position + axis_[i].input.owed();
      known = true;
    }
    if (known) chatter_.tell_position(position_m);
  }

  [[gnu::noinline]] void report_collision(std::size_t i, MonitorState state) noexcept {
    if (puts_off(axis_[i].told, state)) return;
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
    next_change() = {MonitorId::signal,
                     channel,
                     health.state,
                     slot.out.signal,
                     health.share,
                     slot.health.threshold(),
                     static_cast<std::uint8_t>(health.cause),
                     health.faults};
    slot.out.signal = health.state;
  }

  // The monitors of the tool when every drive is heard on every sample.
  [[gnu::noinline]] void watch_tool() noexcept {
    ToolSample<Real>& in = heard_spindle();
    if (over_path_) add_way();
    if (!half_rate_) {
      if (lateral_on_) hear_lateral(in, axis_[0].out.sample, axis_[1].out.sample);
      tool_.hear_spindle(in, tell());
      hear_thrust(in);
      take_way(in);
      tool_.hear_lateral(in, tell());
      tool_.hear_thrust(in, tell());
      expect();
      return;
    }
    tool_.hear_spindle(in, tell());
    // The others take turns, and hear of two samples as of one.
    hear_thrust(in);
    const Past spindle{in.increment_rad, in.spindle};
    join(last_spindle_, in.increment_rad, in.spindle);
    last_spindle_ = spindle;
    if (samples_ % 2 == 0) {
      join(last_thrust_, in.feed_m, in.thrust);
      take_way(in);
      tool_.hear_thrust(in, tell());
      expect();
      for (std::size_t i = 0; i < lateral_.size(); ++i) {
        const DriveSample<Real>& now = axis_[i].out.sample;
        last_lateral_[i] = {now.increment, now.effort, now.quality};
      }
    } else {
      last_thrust_ = {in.feed_m, in.thrust};
      if (lateral_on_) hear_lateral(in, last_two(0), last_two(1));
      tool_.hear_lateral(in, tell());
    }
  }
  // In groups: the teeth with the spindle, AR breakage one sample later, wear with z, drill
  // fracture and the torque band with y.
  [[gnu::noinline]] void watch_in_turns(unsigned turn) noexcept {
    ToolSample<Real>& in = heard_spindle();
    if (turn % 2 == 0) {
      tool_.watch_teeth(in, tell());
      return;
    }
    tool_.watch_ar(in, tell());
    hear_thrust(in);
    join(last_spindle_, in.increment_rad, in.spindle);
    if (turn == turn_of(2)) {
      tool_.watch_wear(in, tell());
    } else {
      take_lateral(in);
      if (over_path_) add_way();
      take_way(in);
      tool_.hear_lateral(in, tell());
      tool_.watch_band(in, tell());
      expect();
    }
  }
  // What the program asks for now, for those beside the torque band.
  void expect() noexcept {
    if (expects_) take_expected();
  }
  [[gnu::noinline]] void take_expected() noexcept {
    const auto& band = tool_.torque_band();
    expected_cut_ = band.expected_cut();
    if (expected_cut_ == nullptr || expected_cut_->kind == ExpectedCutKind::unknown) {
      expected_cut_ = nullptr;
      return;
    }
    const bool air = expected_cut_->kind == ExpectedCutKind::air;
    const Real faster = machine_.feed_override > 1 ? machine_.feed_override : Real(1);
    for (std::size_t i = 0; i < kAxes; ++i) {
      const ForceRange<Real>& force = expected_cut_->force[i];
      expected_force_[i] = {{faster * force.least_N, faster * force.most_N}, air, band.excess_Nm()};
    }
  }

  [[gnu::always_inline]] void hear_lateral(ToolSample<Real>& in, const DriveSample<Real>& x,
                                           const DriveSample<Real>& y) noexcept {
    lateral_[0].process(x);
    lateral_[1].process(y);
    take_lateral(in);
  }
  void take_lateral(ToolSample<Real>& in) const noexcept {
    in.force_x_N = lateral_[0].state().estimate;
    in.force_y_N = lateral_[1].state().estimate;
    in.lateral = lateral_[0].state().quality | lateral_[1].state().quality;
  }

  // The last two samples of an axis as one.
  [[nodiscard]] DriveSample<Real> last_two(std::size_t i) const noexcept {
    DriveSample<Real> both = axis_[i].out.sample;
    const LateralPast& last = last_lateral_[i];
    if (has(both.quality, Quality::restarted)) return both;  // before that lies another life
    both.increment += last.increment;
    both.effort = Real(0.5) * (last.effort + both.effort);
    both.quality |= last.quality;
    return both;
  }
  static void join(const Past& before, Real& increment, Quality& quality) noexcept {
    increment += before.increment;
    quality |= before.quality;
  }

  // What the tool feels now, as far as the spindle tells: the rest is of samples before.
  [[nodiscard]] ToolSample<Real>& heard_spindle() noexcept {
    ToolSample<Real>& in = tool_sample_;
    in.torque_Nm = torque_.value;
    in.turn_angle_rad = spindle_.out.sample.turn_angle_rad;
    in.increment_rad = spindle_.out.sample.increment;
    in.spindle = torque_.quality;
    return in;
  }

  // The way of the axes, and what the controller says, for the torque band.
  void add_way() noexcept {
    for (std::size_t i = 0; i < kAxes; ++i)
      if (axis_[i].present) way_m_[i] += axis_[i].out.sample.increment;
  }
  void take_way(ToolSample<Real>& in) noexcept {
    in.t_ns = machine_.t_ns;
    in.nc_block = machine_.nc_block;
    in.feed_override = machine_.feed_override;
    if (!over_path_) return;
    in.way_m = way_m_;
    way_m_ = {};
  }

  auto tell() noexcept {
    return [this](MonitorId monitor, MonitorState before, MonitorState state, Real value,
                  Real threshold, std::uint8_t detail) noexcept {
      report_tool({monitor, Channel::tool, state, before, value, threshold, detail, 0});
    };
  }
  [[nodiscard]] bool puts_off(typename Slot::Told& told, MonitorState now) const noexcept {
    return told.puts_off(now, static_cast<std::uint32_t>(samples_), patience_);
  }

  void hear_thrust(ToolSample<Real>& in) const noexcept {
    in.level_torque_Nm = spindle_.out.estimate;
    if (!axis_[2].present) return;
    in.thrust_N = axis_[2].out.estimate;
    in.feed_m = axis_[2].out.sample.increment;
    in.thrust = axis_[2].out.quality;
  }

  // What has been told of a monitor of the tool, and what waits to be.
  struct ToolTold {
    typename Slot::Told told;
    MonitorState state = MonitorState::idle;
    StateChange<Real> waiting;
    bool waits = false;
  };
  [[gnu::noinline]] void report_tool(StateChange<Real> change) noexcept {
    ToolTold& t = tool_told_[static_cast<std::size_t>(change.monitor) - kFirstOfTool];
    const bool tooth = change.monitor == MonitorId::tooth_breakage;
    // AR breakage speaks when the step is out of what chatter compares.
    if (tooth && change.state == MonitorState::alarm) chatter_.tell_step();
    change.steps = (tooth || change.monitor == MonitorId::ar_breakage) && chatter_.stepped();
    tell_tool(t, change);
    if (t.waits) t.waiting = change;
  }
  void tell_tool(ToolTold& t, const StateChange<Real>& change) noexcept {
    const MonitorState now = change.state;
    t.waits = now != t.state && puts_off(t.told, now);
    tool_waits_ = tool_waits_ || t.waits;
    if (t.waits || now == t.state) return;
    StateChange<Real>& told = next_change();
    told = change;
    told.before = t.state;
    t.told.tell(t.state, now, static_cast<std::uint32_t>(samples_));
    t.state = now;
  }
  [[gnu::noinline]] void tell_waiting() noexcept {
    tool_waits_ = false;
    for (ToolTold& t : tool_told_)
      if (t.waits) tell_tool(t, t.waiting);
  }

  // Should a monitor ever speak twice on a sample, the last word counts.
  [[nodiscard]] StateChange<Real>& next_change() noexcept {
    if (change_count_ < kMaxChanges) ++change_count_;
    return changes_[change_count_ - 1];
  }
  StateChange<Real>& report(Slot& slot, MonitorId monitor, Channel channel,
                            MonitorState state) noexcept {
    StateChange<Real>& change = next_change();
    change.monitor = monitor;
    change.channel = channel;
    change.before = slot.out.state;
    slot.told.tell(change.before, state, static_cast<std::uint32_t>(samples_));
    change.state = slot.out.state = state;
    change.faulty = 0;
    change.frequency_hz = change.error_hz = 0;
    return change;
  }

  struct LateralPast {
    Real increment = 0;
    Real effort = 0;
    Quality quality = Quality::good;
  };
  struct Machine {
    Nanoseconds t_ns = 0;
    std::int32_t nc_block = kNoBlock;
    Real feed_override = 1;
  };

  // What is small and needed on every sample comes first: it stays in reach of one instruction.
  std::uint64_t samples_ = 0;
  std::size_t change_count_ = 0;
  ToolSample<Real> tool_sample_;
  Heard torque_;  // of the spindle, newest
  Machine machine_;
  Past last_spindle_;
  Past last_thrust_;
  std::array<LateralPast, 2> last_lateral_{};
  const ExpectedCut<Real>* expected_cut_ = nullptr;
  bool tool_on_ = false;
  bool lateral_on_ = false;
  bool half_rate_ = false;
  bool expects_ = false;    // the torque band has a program, which says more than torque
  bool over_path_ = false;  // the torque band follows the way of the axes
  bool grouped_ = false;
  bool configured_ = false;
  bool tool_waits_ = false;
  std::uint32_t patience_ = 0;       // samples for which a monitor that stood down stays so
  std::array<Real, kAxes> way_m_{};  // since the torque band was last heard
  std::array<Observer, 2> lateral_;  // of x and y, for the tool
  Slot spindle_;
  std::array<Slot, Axes> axis_;
  CutDetector<Real> cut_;
  std::array<Collision, Axes> collision_;
  Chatter chatter_;
  [[no_unique_address]] Tool tool_;
  std::array<ExpectedForce<Real>, kAxes> expected_force_{};
  std::array<ToolTold, kToolMonitors.size()> tool_told_{};
  std::array<StateChange<Real>, kMaxChanges> changes_{};
};

}  // namespace servosense
