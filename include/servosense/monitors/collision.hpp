// Tool collision, from the rate of change of the disturbance force.
//
// Purpose: fires when the force on a feed axis changes as fast as no cut does: a tool that runs
// into something, or breaks (Koike 2016, ch. 5).
//   jerk = [s g/(s+g)] F,   F from an observer with both cutoffs at g = 335 rad/s      [N/s]
//   notches at the lines of the sampling structure, two-sample average (null at half the rate)
//   alarm when |jerk - mean| >= threshold (mean + 6 sigma of the idle run) for three samples
// Both signs count: a contact loads the axis, a breaking tool unloads it. The level of F does not
// matter, so neither friction errors nor slow thermal drift can raise it.
//
// Phases: each phase of motion (motion_phase.hpp) may have a threshold of its own, which the source
// names as the cure for its misses and false alarms. Where the phase is not known, the single
// threshold holds.
// Cuts: tooth passing moves the force of an axis faster than any idling run. In a cut the threshold
// is cutting_threshold_N_per_s, which a sound part has taught; until then there is none, and the
// monitor is unarmed there. Presence of a cut (cut_detector.hpp):
//   air        spindle stands, or the axis moves faster than maximum_feed_m_s: the thresholds above
//   cutting    the one of the cut
//   possible   the one of the cut at once; a force above that of the air is given wait_s to prove a
//              first contact by torque, and is a collision if none has come by then
// Torque: what cuts takes torque. Forces F_i of teeth at a radius r, of which the radial part is k
// times the tangential, give |sum F_i| <= sqrt(1 + k^2) sum T_i / r, however they lie. So
//   |F| > friction_N + noise + a T / r,   a = 2 (k up to 1.7), noise = threshold/g
// is no cut, taught or not: the thresholds of the air hold. Where a cut may begin and r is not
// known, that of the smallest tool, 2 mm, excuses what its torque may explain.
// Program: where it is known what the program asks for here (monitors/expected_cut.hpp), a force
// beyond its range by friction_N + noise is no cut's, nor any force where nothing is removed; the
// thresholds of the air hold. Torque beyond its band, by which the whole cut asks for more than was
// predicted, widens the range by a dT / r.
// Resonance: with the motor held, a stage on a soft screw swings at w^2 = K/M. What acceleration
// leaves of that swing and what a contact does both reach the motor through 1/(s^2 + w^2) (Koike
// 2016, eq. 2-12 to 2-14), whatever the controller does; a notch at w takes the ring out.
//
// Discretisation: Tustin (dsp/first_order.hpp, dsp/notch.hpp). A notch at 0.45 of the sample rate
// or above is left out: at 1 kHz none of the source's remains (`notch_used` says which are there).
// Faults: the filters step over a single stand-in, which errs by a T^2 of travel at most; from the
// second in a row on, after a gap and after a restart, they start anew, because the make-up step of
// a longer bridge looks like a contact. Until they have settled again the monitor is `learning`.
// Delay: a force that rises at r from the contact on reads r (1 - e^-x (1 + x + x^2/2)), x = g t,
// plus 1.5 samples and the notches' (docs/collision.md); then the three samples.
// Cost on Cortex-M4F: bench/firmware/instructions.csv, and a notch more with a resonance.
// Range: 0 < g T < 2.
// Numerical bound: sums over 2 ms only; nothing drifts.
// An axis that turns: every N is Nm, every m is rad, and there is no tool radius.
// Bad at: soft contacts below the threshold; a resonance that wanders further than its notch is
// wide; cuts faster than maximum_feed_m_s, or too light for the spindle to show.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/whole.hpp"
#include "servosense/monitors/collision_config.hpp"
#include "servosense/monitors/cut_detector.hpp"
#include "servosense/monitors/disturbance_jerk.hpp"
#include "servosense/monitors/evidence.hpp"
#include "servosense/monitors/expected_cut.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/motion_phase.hpp"

namespace servosense {

template <RealNumber Real>
class CollisionMonitor {
 public:
  using Config = CollisionConfig;
  static constexpr std::size_t kEvidenceStride = 32;
  /// Stand-ins in a row that the filters step over.
  static constexpr std::uint32_t kTolerated = 1;
  /// That an alarm outlasts without a signal to tell of it.
  static constexpr double kPatience_s = 1;

  static constexpr Real kUnknownTravel = std::numeric_limits<Real>::quiet_NaN();

  struct Input {
    Real force_N = 0;
    Quality quality = Quality::good;
    MotionPhase phase = MotionPhase::unknown;
    CutPresence cut = CutPresence::air;
  };
  /// What the monitor remembers between samples.
  struct State {
    Real jerk_N_per_s = 0;
    MonitorState state = MonitorState::idle;
    SignalState signal = SignalState::filling;
    std::uint64_t alarms = 0;
    std::uint64_t faults = 0;  ///< samples not used
    std::uint32_t faults_in_a_row = 0;
    Real weight = 1;  ///< single threshold over that of the last sample; 0: there was none
  };
  /// A force beyond the threshold of the air where a cut may begin.
  struct Suspicion {
    std::uint32_t over = 0;  ///< samples in a row
    std::uint32_t left = 0;  ///< of the wait and of what an alarm takes
    Real highest = 0;        ///< in terms of the single threshold...
    Real weight = 1;         ///< ...and that over the threshold it passed
    Real force_N = 0;        ///< largest since then
  };
  struct Core {
    DisturbanceJerk<Real> jerk;
    AlarmLogic<Real> alarm;
    State state;
    Suspicion suspicion;
  };
  using Recorder = EvidenceRecorder<Core, Input, kEvidenceStride>;
  using Evidence = typename Recorder::Evidence;

  static Status validate(const Config& c) noexcept {
    const FirstOrderConfig g{c.cutoff_rad_s, c.sample_period_s, Discretisation::tustin};
    if (const Status s = validate_first_order(g); !s.ok()) return s;
    for (const double f : c.notch_hz)
      if (!(f >= 0 && is_finite(f)))
        return Status::invalid("notch_hz", "must be zero (none) or a positive frequency");
    if (!(c.notch_quality > 0)) return Status::invalid("notch_quality", "must be positive");
    for (const double t : c.phase_threshold_N_per_s)
      if (!(t >= 0 && is_finite(t)))
        return Status::invalid("phase_threshold_N_per_s", "must be zero (none) or positive");
    if (const Status s = MotionPhaseTracker<Real>::validate(phases(c)); !s.ok()) return s;
    if (!(c.cutting_threshold_N_per_s >= 0 && is_finite(c.cutting_threshold_N_per_s)))
      return Status::invalid("cutting_threshold_N_per_s", "must be zero (none) or positive");
    if (!(c.maximum_feed_m_s > 0 && is_finite(c.maximum_feed_m_s)))
      return Status::invalid("maximum_feed_m_s", "must be positive");
    if (!(c.wait_s >= 0 && c.wait_s < 1e6 * c.sample_period_s))
      return Status::invalid("wait_s", "must be at least 0, below a million samples");
    if (!(c.resonance_hz >= 0 && is_finite(c.resonance_hz)))
      return Status::invalid("resonance_hz", "must be zero (none) or a positive frequency");
    if (!(c.resonance_quality > 0 && is_finite(c.resonance_quality)))
      return Status::invalid("resonance_quality", "must be positive");
    if (!(c.tool_radius_m >= 0 && is_finite(c.tool_radius_m)))
      return Status::invalid("tool_radius_m", "must be zero (not known) or positive");
    if (!(c.friction_N >= 0 && is_finite(c.friction_N)))
      return Status::invalid("friction_N", "must be at least 0");
    if (!is_finite(c.mean_N_per_s)) return Status::invalid("mean_N_per_s", "must be finite");
    const Status s = AlarmLogic<Real>::validate(logic(c));
    return s.ok() || s.parameter()[0] != 't' ? s : Status::invalid("threshold_N_per_s", s.reason());
  }
  void configure(const Config& c) noexcept {
    core_.jerk.configure(c);
    core_.alarm.configure(logic(c));
    motion_.configure(phases(c));
    rules_.mean = static_cast<Real>(c.mean_N_per_s);
    rules_.weight.fill(Real(1));
    for (std::size_t i = 0; i < kMotionPhases; ++i)
      if (c.threshold_N_per_s > 0 && c.phase_threshold_N_per_s[i] > 0)
        rules_.weight[i] = static_cast<Real>(c.threshold_N_per_s / c.phase_threshold_N_per_s[i]);
    rules_.cutting = c.cutting_threshold_N_per_s > 0
                         ? static_cast<Real>(c.threshold_N_per_s / c.cutting_threshold_N_per_s)
                         : Real(0);
    constexpr double kForceShare = 2;           // of T/r; radial up to 1.7 times tangential
    constexpr double kSmallestRadius_m = 2e-3;  // thinner tools break before they do harm
    rules_.per_torque = static_cast<Real>(c.tool_radius_m > 0 ? kForceShare / c.tool_radius_m : 0);
    rules_.excuse = static_cast<Real>(kForceShare / kSmallestRadius_m);
    rules_.other_N = static_cast<Real>(c.friction_N + c.threshold_N_per_s / c.cutoff_rad_s);
    rules_.floor_N = c.tool_radius_m > 0 ? rules_.other_N : std::numeric_limits<Real>::infinity();
    rules_.level = c.threshold_N_per_s > 0 ? static_cast<Real>(c.threshold_N_per_s)
                                           : std::numeric_limits<Real>::infinity();
    rules_.consecutive = c.consecutive_samples;
    rules_.wait = nearest_whole(c.wait_s / c.sample_period_s);
    const double block = std::round(phases(c).block_s / c.sample_period_s);
    rapid_ = static_cast<Real>(c.maximum_feed_m_s * c.sample_period_s * (block > 2 ? block : 2));
    reset();
  }
  void reset() noexcept {
    core_.jerk.reset();
    core_.alarm.reset();
    motion_.reset();
    core_.state = State{};
    core_.suspicion = Suspicion{};
    recorder_.reset();
  }
  /// After reset(): the evidence is copied on other samples, so many earlier, than that of a
  /// monitor beside this one. Below kEvidenceStride.
  void stagger(std::uint32_t samples) noexcept {
    recorder_.reset(samples);
    recorder_.prepare(core_);
  }

  /// One servo period: disturbance force of the axis [N], its travel since the last sample [m],
  /// what is known against them, what the tool does and the torque that it takes [Nm], steadily and
  /// at its peak (CutDetector::State), and what the program explains, where it is known.
  [[gnu::always_inline]] MonitorState process(
      Real force_N, Real increment_m, Quality quality, CutPresence cut = CutPresence::air,
      Real torque_Nm = 0, Real load_Nm = 0,
      const ExpectedForce<Real>* program = nullptr) SERVOSENSE_NONBLOCKING {
    motion_.process(increment_m);
    Input in{force_N, quality, motion_.phase(), cut};
    if (cut != CutPresence::air) {
      in.cut = presence(std::abs(force_N), cut, torque_Nm, load_Nm);
      if (program != nullptr && !explains(*program, force_N)) in.cut = CutPresence::air;
    }
    recorder_.before(core_, in);
    const MonitorState before = core_.alarm.state().state;
    const MonitorState now = step(core_, in, rules_);
    if (now == MonitorState::alarm && before != MonitorState::alarm) recorder_.freeze();
    return now;
  }
  /// Without the travel: the phase of motion is not known.
  [[gnu::always_inline]] MonitorState process(Real force_N,
                                              Quality quality) SERVOSENSE_NONBLOCKING {
    return process(force_N, kUnknownTravel, quality);
  }

  [[nodiscard]] const State& state() const noexcept { return core_.state; }
  /// That the last sample was held against; 0 where it was held against none: in a cut that
  /// nothing has been taught of.
  [[nodiscard]] Real threshold_N_per_s() const noexcept {
    const Real weight = core_.state.weight;
    return weight > 0 ? core_.alarm.threshold() / weight : Real(0);
  }
  /// Hears jerks in terms of the single threshold: times that over the one of the phase.
  [[nodiscard]] const AlarmLogic<Real>& alarm() const noexcept { return core_.alarm; }
  /// Phase of the motion, as held; unknown without travel.
  [[nodiscard]] MotionPhase phase() const noexcept { return motion_.phase(); }
  [[nodiscard]] const DisturbanceJerk<Real>& jerk() const noexcept { return core_.jerk; }
  /// What the last alarm was raised from; count = 0 before the first.
  /// A copy; off the real-time path.
  [[nodiscard]] Evidence evidence() const noexcept { return recorder_.evidence(); }
  /// Feeds the evidence to the block as it was; returns it after the last sample. Off the real-time
  /// path. Requires configure() with the configuration of the alarm.
  [[nodiscard]] Core replay(const Evidence& e) const noexcept {
    Core core = e.before;
    for (std::uint32_t i = 0; i < e.count; ++i) step(core, e.inputs[i], rules_);
    return core;
  }

 private:
  struct Rules {
    Real mean = 0;
    std::array<Real, kMotionPhases + 1> weight{};  // the last one: not known
    Real cutting = 0;                              // weight in the cut, 0 = not taught
    Real level = 0;                                // the single threshold; infinite: off
    Real per_torque = 0;                           // largest force of a cut over its torque...
    Real floor_N = 0;  // ...beside what needs none; infinite: radius not known
    Real other_N = 0;  // that is no cut's: friction and noise
    Real excuse = 0;   // largest of any tool
    std::uint32_t consecutive = 1;
    std::uint32_t wait = 0;
  };

  static MotionPhaseConfig phases(const Config& c) noexcept {
    MotionPhaseConfig p;
    p.sample_period_s = c.sample_period_s;
    // What the filters remember of the motion: ten time constants leave 0.3 % of it.
    p.hold_s = 10 / c.cutoff_rad_s;
    p.accelerating_m_s2 = c.accelerating_m_s2;
    p.standing_m_s = c.standing_m_s;
    return p;
  }
  static AlarmLogicConfig logic(const Config& c) noexcept {
    return {c.threshold_N_per_s,   c.warning_fraction,
            c.release_fraction,    c.release_samples,
            c.consecutive_samples, nearest_whole(kPatience_s / c.sample_period_s)};
  }

  // What this axis makes of it.
  [[nodiscard]] CutPresence presence(Real size_N, CutPresence cut, Real torque_Nm,
                                     Real load_Nm) const noexcept {
    // Travel of the last block of motion.
    if (std::abs(motion_.state().last) > rapid_) return CutPresence::air;
    if (size_N > rules_.floor_N + rules_.per_torque * load_Nm) return CutPresence::air;
    // Torque that is no cut's by itself, but as much as the force that waits for it asks for.
    const Suspicion& doubt = core_.suspicion;
    if (cut == CutPresence::possible && doubt.left > 0 &&
        rules_.excuse * std::abs(torque_Nm) >= doubt.force_N)
      return CutPresence::cutting;
    return cut;
  }

  [[nodiscard]] bool explains(const ExpectedForce<Real>& program, Real force_N) const noexcept {
    if (program.air) return false;
    if (program.excess_Nm > 0 && !(rules_.per_torque > 0)) return true;
    const Real more_N = rules_.other_N + rules_.per_torque * program.excess_Nm;
    return force_N >= program.force.least_N - more_N && force_N <= program.force.most_N + more_N;
  }

  static constexpr Quality kBreaks = Quality::restarted | Quality::gap | Quality::settling;

  static MonitorState step(Core& core, const Input& in, const Rules& rules) noexcept {
    // The everyday sample, in few instructions; the full path gives the same result. While the
    // signal is good the filters have settled and no fault is pending.
    if (core.state.signal == SignalState::good && in.quality <= Quality::held &&
        is_moderate(in.force_N)) {
      core.state.jerk_N_per_s = core.jerk.advance(in.force_N);
      return judge(core, in, rules, SignalState::good);
    }
    return step_in_full(core, in, rules);
  }

  [[gnu::noinline]] static MonitorState step_in_full(Core& core, const Input& in,
                                                     const Rules& rules) noexcept {
    State& s = core.state;
    if (has(in.quality, kBreaks | kUnusable) || !is_moderate(in.force_N)) {
      take_fault(core, in.quality);
    } else {
      s.faults_in_a_row = 0;
      s.jerk_N_per_s = core.jerk.process(in.force_N);
      s.signal = !core.jerk.settled()                 ? SignalState::filling
                 : has(in.quality, Quality::doubtful) ? SignalState::doubtful
                                                      : SignalState::good;
    }
    return judge(core, in, rules, s.signal);
  }

  static MonitorState judge(Core& core, const Input& in, const Rules& rules,
                            SignalState signal) noexcept {
    State& s = core.state;
    const MonitorState before = core.alarm.state().state;
    const Real size = std::abs(s.jerk_N_per_s - rules.mean);
    s.weight = rules.weight[static_cast<std::size_t>(in.phase)];
    Real value = s.weight * size;
    if (in.cut != CutPresence::air || core.suspicion.over > 0 || core.suspicion.left > 0)
      value = judge_cut(core, in, rules, size, value);
    const MonitorState now = core.alarm.process(value, signal);
    if (now != before) take_change(s, now);
    return now;
  }

  // What the alarm hears where the tool cuts, or may begin to.
  static Real judge_cut(Core& core, const Input& in, const Rules& rules, Real size,
                        Real in_air) noexcept {
    State& s = core.state;
    Suspicion& doubt = core.suspicion;
    const bool may_begin = in.cut == CutPresence::possible && in_air >= rules.level;
    if (may_begin || (doubt.left > 0 && in.cut != CutPresence::cutting))
      return suspect(core, in, rules, size, in_air);
    doubt.over = doubt.left = 0;
    if (in.cut == CutPresence::air) return in_air;
    if (rules.cutting < s.weight) s.weight = rules.cutting;
    return s.weight * size;
  }

  [[gnu::noinline]] static Real suspect(Core& core, const Input& in, const Rules& rules, Real size,
                                        Real in_air) noexcept {
    State& s = core.state;
    Suspicion& doubt = core.suspicion;
    const Real size_N = std::abs(in.force_N);
    if (in_air > doubt.highest || doubt.left == 0) {
      doubt.highest = in_air;
      doubt.weight = s.weight;
    }
    if (doubt.left == 0 || size_N > doubt.force_N) doubt.force_N = size_N;
    doubt.over = in_air >= rules.level ? doubt.over + 1 : 0;
    if (doubt.left == 0 && doubt.over >= rules.consecutive)
      doubt.left = rules.wait + rules.consecutive;
    if (in.cut == CutPresence::air) {  // no cut can follow: the spindle stands, a rapid has begun
      if (doubt.left > rules.consecutive) doubt.left = rules.consecutive;
    } else if (rules.cutting < s.weight) {
      s.weight = rules.cutting;
    }
    const Real value = s.weight * size;
    if (doubt.left == 0) return value;
    --doubt.left;
    if (doubt.left >= rules.consecutive || value > doubt.highest) return value;
    s.weight = doubt.weight;  // no torque has come: it was no cut
    return doubt.highest;
  }

  [[gnu::noinline]] static void take_change(State& s, MonitorState now) noexcept {
    if (now == MonitorState::alarm) ++s.alarms;
    s.state = now;
  }

  [[gnu::noinline]] static void take_fault(Core& core, Quality quality) noexcept {
    State& s = core.state;
    core.suspicion = Suspicion{};
    if (has(quality, kBreaks)) {
      if (core.jerk.state().samples > 0) core.jerk.reset();
      s.faults_in_a_row = 0;
      s.signal = has(quality, Quality::gap) ? SignalState::faulty : SignalState::filling;
      return;
    }
    ++s.faults;
    if (s.faults_in_a_row < kTolerated) {  // the filters step over it, with what they have
      ++s.faults_in_a_row;
      core.alarm.interrupt();
      s.signal = core.jerk.settled() ? SignalState::doubtful : SignalState::filling;
      return;
    }
    s.signal = SignalState::faulty;
    core.jerk.reset();
  }

  Core core_;
  MotionPhaseTracker<Real> motion_;
  Rules rules_;
  Real rapid_ = 0;  // travel of a block of motion
  Recorder recorder_;
};

}  // namespace servosense
