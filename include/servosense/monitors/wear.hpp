// Tool wear, from the thrust and torque of each hole or pass.
//
// Purpose: says when a drill, a tap or another tool is worn out or has chipped, from the cutting
// force and torque that feed axis and spindle estimate anyway (Koike 2016, ch. 4; observers at 500
// rad/s). The source's rules are made by drill_6mm(), drill_3mm(), tap_m6() and tap_m3().
// Equation: signals are averaged over parts of `part_s`; e(v) = o + c sgn(v) + d v is what friction
// has changed by since the machine was identified, and a part reads force - e(v).
//   cut:    a part that goes into the workpiece at feed, spindle turning, at or above the cutting
//           thrust or torque; ends below `release_fraction` of both, or when the feed ends
//   hole:   mean over the cut's parts at steady speed, without its first entry_m and last exit_m
//   level:  mean over the last average_holes holes   -> thrust_limit_N, torque_limit_Nm
//   ratio:  level / mean of the first teach_holes    -> thrust_ratio, torque_ratio
//   force:  specific cutting force of milling over that of the new tool, as the cutting
//           coefficients have it (cutting_coefficients.hpp), the lower end of its 95 % interval
//                                                    -> specific_force_ratio
//   step:   nearest of the last confirm_holes holes - median of the three before them, up
//           (chipping) or down (fracture)            -> thrust_step_N, torque_step_Nm
// A step is raised from limit - a on, a = min(3.6 s, limit / 4), s the scatter of the taught holes:
// so a step as large as the limit is found, not missed every other time (a hole and the median of
// three others differ by 1.20 s rms). The median, because one odd hole is no step; three holes,
// because more of them lag behind a tool that wears fast. Steady is a speed that changes by less
// than steady_fraction from part to part, or so slowly that inertia asks for less than half of what
// means cutting: that much an axis gives way to chips, and an observer that knows its mass within a
// tenth reads it wrong by a twentieth. Friction changes with heat (55 N in the source). o, c, d are
// learned again in every air move at steady speed by a Kalman filter on a random walk, spindle
// friction likewise while it turns in the air. Air is: rapids, the way back above the hole, and the
// first clearance_m of a stroke at feed. What is found about a tool stands until new_tool(): a drop
// after a fracture clears nothing.
// Discretisation: parts; five more samples after a part for its filters, the verdict and the
// evidence.
// Delay: a verdict with the part that ends the cut (with pecks: peck_window_s later or with the
// next hole), confirm_holes holes for a step, (average_holes - 1) / 2 for a slow rise.
// Cost on Cortex-M4F: 89 instructions, 320 for the worst sample.
// Range: |force|, |torque| < 1e15; feeds from maximum_feed_m_s / 1000 on.
// Numerical bound: sums live one part, means one hole; the filters are contractions; nothing drifts
// in 24 h.
// Bad at: holes shorter than entry + exit + shortest_m (`short_cuts` counts them); a drill that is
// gone altogether (no thrust, no hole); friction that changes with position; cuts at rapid.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/whole.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/wear_config.hpp"
#include "servosense/monitors/wear_cut.hpp"
#include "servosense/monitors/wear_tool.hpp"

namespace servosense {

/// KeptParts: longest hole, in parts, whose alarm can be replayed; a longer one is raised without.
template <RealNumber Real, std::size_t KeptParts = 128>
class WearMonitor {
  static_assert(KeptParts >= 1);

 public:
  using Config = WearConfig;
  using Hole = WearHole<Real>;
  using Part = WearPart<Real>;
  using Tool = WearTool<Real>;

  /// Everything that passes from part to part.
  struct Core : WearCut<Real> {
    Tool tool;
  };

  struct State {
    MonitorState state = MonitorState::idle;
    SignalState signal = SignalState::filling;
    std::uint64_t sample = 0;
    std::uint64_t holes = 0;      ///< judged, all tools
    std::uint64_t alarms = 0;     ///< tools
    std::uint64_t stand_ins = 0;  ///< samples not used
    std::uint64_t restarts = 0;
  };

  /// What an alarm is replayed from: the monitor as the hole had begun, and the parts since.
  struct Evidence {
    Core before;
    std::array<Part, KeptParts> parts{};
    std::uint32_t count = 0;  ///< 0: no alarm yet, none of a hole, or the hole was too long
  };

  static Status validate(const Config& c) noexcept { return servosense::validate(c); }

  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    part_samples_ = nearest_whole(c.part_s / c.sample_period_s);
    fewest_ = part_samples_ - whole(c.tolerated_stand_ins * part_samples_);
    cuts_.configure(c, part_samples_ * c.sample_period_s);
    rules_.configure(c);
    reset();
  }

  /// Forgets everything, the tool included.
  void reset() noexcept {
    cuts_.reset(core_);
    core_.tool = Tool{};
    sums_ = Sums{};
    state_ = State{};
    stage_ = 0;
    recording_ = false;
    slot_ = 0;
    count_ = {};
    pinned_ = kNone;
  }
  /// Another tool. Give what tool() said of it when it was last in the spindle, if it ever was.
  /// What is known of friction stays.
  void new_tool(const Tool& tool = {}) noexcept {
    cuts_.give_up(core_);
    recording_ = false;
    core_.tool = tool;
    show();
  }
  /// The tool's first holes as they were taught on another of its kind; skips teaching.
  void set_taught(Real thrust_N, Real thrust_scatter_N, Real torque_Nm,
                  Real torque_scatter_Nm) noexcept {
    Tool& t = core_.tool;
    t.thrust.taught = thrust_N;
    t.thrust.scatter = thrust_scatter_N;
    t.torque.taught = torque_Nm;
    t.torque.scatter = torque_scatter_Nm;
    t.taught = rules_.teach_holes();
    show();
  }

  /// One servo period: cutting force of the feed axis, its increment, cutting torque of the
  /// spindle, its increment, and what is known against any of them.
  MonitorState process(Real force_N, Real feed_m, Real torque_Nm, Real turned_rad,
                       Quality quality) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    Sums& p = sums_;
    ++s.sample;
    if (stage_ != 0) run_stage();
    // In one test: four numbers, each within reason.
    const Real check = (force_N * force_N + torque_Nm * torque_Nm) * Real(1e-30) + feed_m * feed_m +
                       turned_rad * turned_rad * Real(1e-4);
    if (has(quality, kBreaks | kUnusable) || !(check < Real(1))) {
      if (!take_fault(quality, feed_m, turned_rad)) return s.state;
    } else {
      if (s.signal != SignalState::good) set_signal(SignalState::good);
      p.force += force_N;
      p.torque += torque_Nm;
      p.travel += feed_m;
      p.turned += turned_rad;
      p.last_feed = feed_m;
      p.last_turned = turned_rad;
      if (force_N < p.force_low) p.force_low = force_N;
      if (force_N > p.force_high) p.force_high = force_N;
      if (torque_Nm < p.torque_low) p.torque_low = torque_Nm;
      if (torque_Nm > p.torque_high) p.torque_high = torque_Nm;
      ++p.good;
    }
    if (++p.samples == part_samples_) close_part();
    return s.state;
  }

  /// Of a stretch milled: specific cutting force over that of the new tool, with its standard error
  /// (CuttingCoefficients::force_ratio(), once it is told). Both finite, error >= 0.
  void hear_cutting(Real ratio, Real error) noexcept {
    const MonitorState before = core_.tool.condition;
    rules_.judge_cutting(core_.tool, ratio, error);
    if (core_.tool.condition == MonitorState::alarm && before != MonitorState::alarm) {
      ++state_.alarms;
      pinned_ = kNone;
    }
    show();
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  [[nodiscard]] const Core& core() const noexcept { return core_; }
  [[nodiscard]] const Tool& tool() const noexcept { return core_.tool; }
  /// The last complete hole.
  [[nodiscard]] const Hole& hole() const noexcept { return core_.complete; }
  /// Friction of the axis, and of the spindle, over what was identified; and its standard
  /// deviation. Off the real-time path.
  [[nodiscard]] Real friction_N(Real feed_m_s) const noexcept {
    return cuts_.friction().at(core_.friction, feed_m_s);
  }
  [[nodiscard]] Real spindle_friction_Nm(Real speed_rad_s) const noexcept {
    return cuts_.spindle().at(core_.spindle, speed_rad_s);
  }
  [[nodiscard]] Real friction_sigma_N(Real feed_m_s) const noexcept {
    return std::sqrt(cuts_.friction().variance(core_.friction, feed_m_s));
  }

  /// What the last alarm was raised from. A copy; off the real-time path.
  [[nodiscard]] Evidence evidence() const noexcept {
    Evidence e;
    if (pinned_ == kNone) return e;
    e.before = before_[pinned_];
    e.parts = parts_[pinned_];
    e.count = count_[pinned_];
    return e;
  }
  /// The monitor's core after the last part of the evidence: its tool has the alarm, bit for bit.
  /// Off the real-time path. Requires configure() with the configuration of the alarm.
  [[nodiscard]] Core replay(const Evidence& e) const noexcept {
    Core core = e.before;
    for (std::uint32_t i = 0; i < e.count; ++i) {
      cuts_.segment(core, e.parts[i]);
      cuts_.learn_friction(core);
      cuts_.learn_spindle(core);
      if (core.verdict) judge(core);
    }
    return core;
  }

 private:
  struct Sums {
    Real force = 0, torque = 0, travel = 0, turned = 0;
    Real last_feed = 0, last_turned = 0;  // of the last good sample
    Real force_low = kFar, force_high = -kFar, torque_low = kFar, torque_high = -kFar;
    std::uint32_t samples = 0;
    std::uint32_t good = 0;
  };
  static constexpr Real kFar = Real(1e30);
  static constexpr std::size_t kNone = 2;
  static constexpr Quality kBreaks = Quality::restarted | Quality::gap | Quality::settling;
  static Real magnitude(Real x) noexcept { return x < 0 ? -x : x; }

  // ---- samples ---------------------------------------------------------------------------------

  // False when the sample does not belong to any part.
  [[gnu::noinline]] bool take_fault(Quality quality, Real feed_m, Real turned_rad) noexcept {
    if (has(quality, kBreaks)) {
      if (state_.signal == SignalState::good) start_anew();
      set_signal(has(quality, Quality::gap) ? SignalState::faulty : SignalState::filling);
      return false;
    }
    ++state_.stand_ins;
    set_signal(SignalState::faulty);
    // The axis moves on meanwhile.
    sums_.travel += magnitude(feed_m) < 1 ? feed_m : sums_.last_feed;
    sums_.turned += magnitude(turned_rad) < 100 ? turned_rad : sums_.last_turned;
    return true;
  }
  void start_anew() noexcept {
    ++state_.restarts;
    sums_ = Sums{};
    stage_ = 0;
    cuts_.start_anew(core_);  // nobody knows how long it was
    recording_ = false;
  }

  [[gnu::noinline]] void set_signal(SignalState signal) noexcept {
    state_.signal = signal;
    show();
  }
  // What is known of the tool, unless the signal has a say.
  void show() noexcept {
    const Tool& t = core_.tool;
    if (state_.signal == SignalState::faulty)
      state_.state = MonitorState::signal_fault;
    else if (rules_.none())
      state_.state = MonitorState::idle;
    else if (t.condition != MonitorState::armed)
      state_.state = t.condition;
    else if (!rules_.taught(t) || state_.signal == SignalState::filling)
      state_.state = MonitorState::learning;
    else
      state_.state = MonitorState::armed;
  }

  // ---- parts -----------------------------------------------------------------------------------

  [[gnu::noinline]] void close_part() noexcept {
    const Sums& p = sums_;
    part_.usable = p.good >= fewest_ && p.good > 0;
    if (part_.usable) {
      const Real scale = Real(1) / static_cast<Real>(p.good);
      part_.thrust_N = p.force * scale;
      part_.torque_Nm = p.torque * scale;
      part_.thrust_low_N = p.force_low;
      part_.thrust_high_N = p.force_high;
      part_.torque_low_Nm = p.torque_low;
      part_.torque_high_Nm = p.torque_high;
    }
    part_.travel_m = p.travel;
    part_.turned_rad = p.turned;
    Sums next;
    next.last_feed = p.last_feed;
    next.last_turned = p.last_turned;
    sums_ = next;
    stage_ = 1;
  }

  // One stage a sample, so that no sample costs much more than another.
  [[gnu::noinline]] void run_stage() noexcept {
    Core& c = core_;
    switch (stage_++) {
      case 1:
        keep(part_);
        cuts_.segment(c, part_);
        return;
      case 2:
        cuts_.learn_friction(c);
        return;
      case 3:
        cuts_.learn_spindle(c);
        return;
      case 4:
        if (c.verdict) take_verdict();
        return;
      default:
        stage_ = 0;
        if (c.just_opened) begin_recording();
    }
  }

  // ---- holes -----------------------------------------------------------------------------------

  void judge(Core& c) const noexcept {
    c.verdict = false;
    rules_.judge(c.tool, c.complete.thrust_N, c.complete.torque_Nm);
  }
  void take_verdict() noexcept {
    const MonitorState before = core_.tool.condition;
    judge(core_);
    ++state_.holes;
    if (core_.tool.condition == MonitorState::alarm && before != MonitorState::alarm) {
      ++state_.alarms;
      pin();
    }
    show();
  }

  // ---- evidence --------------------------------------------------------------------------------

  // Two slots: an alarm pins the present one, and recording goes on in the other.
  void begin_recording() noexcept {
    slot_ = pinned_ == 0 ? 1 : 0;
    before_[slot_] = core_;
    count_[slot_] = 0;
    recording_ = true;
  }
  void keep(const Part& part) noexcept {
    if (!recording_) return;
    if (count_[slot_] == KeptParts) {
      recording_ = false;
      return;
    }
    parts_[slot_][count_[slot_]++] = part;
  }
  void pin() noexcept {
    pinned_ = recording_ ? slot_ : kNone;
    recording_ = false;
  }

  Core core_;
  Sums sums_;
  State state_;
  Part part_;
  std::uint32_t stage_ = 0;
  bool recording_ = false;
  std::size_t slot_ = 0;
  std::size_t pinned_ = kNone;
  std::array<std::uint32_t, 2> count_{};
  std::array<Core, 2> before_{};
  std::array<std::array<Part, KeptParts>, 2> parts_{};

  WearCutFinder<Real> cuts_;
  WearRules<Real> rules_;
  std::uint32_t part_samples_ = 80;
  std::uint32_t fewest_ = 60;
};

}  // namespace servosense
