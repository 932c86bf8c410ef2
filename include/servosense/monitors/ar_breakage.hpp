// Tool breakage from the spindle torque alone, by what a recursive AR model did not foresee.
//
// Purpose: finds the loss of part of one edge of a multi-tooth cutter, which changes neither mean
// nor peak much, without being taught the cut (Bertok 1984, ch. 3 and 5).
//   z    = mean torque over each half of a tooth period, by spindle angle (dsp/angle_sampler.hpp)
//   e    = residual of a recursive AR model of z two revolutions long (dsp/lattice_ar.hpp)
//   R    = |e| over the rms of those before, or, when larger, 2/3 of the root of the sum of four
//          squared residuals, those of the broken tooth and of its successor, over the rms of the
//          ten before them: wide cuts and helix spread the change (dsp/moving_threshold.hpp)
// An event is sudden, R >= residual_ratio in the revolution of the change, and lasts: the torque of
// the teeth has changed once per revolution, twice in the same way, while the level stayed
// (dsp/repeated_change.hpp; limits on repetition and steadiness). Where a tooth begins in angle is
// not known, so both ways to pair the halves are followed.
//   alarm  event, and the share of a tooth's usual torque that moved, less what a change of the
//          level alone explains, >= share_threshold. Usual is the highest level, forgotten as the
//          model forgets. Where the feed stops or the cut ends run-out is all that
//          is left of the torque, so nothing counts below half (steadiness_limit) of the usual.
// The study decides on a single residual, R >= 10, and claims no false alarm at entry and exit. In
// simulated cuts that rule alarms falsely in 38 records of 100 (docs/ar-breakage.md); the second
// condition removes them, because what entries change does not repeat.
// Discretisation: by angle, so nothing depends on the spindle speed. Stages of the lattice are
// spread over the servo periods of the half tooth, `stages_per_sample` in each; then R, the
// comparison of the revolutions and the verdict take one each. What is left when the half tooth
// ends is done at once.
// Faults: single bad samples are bridged by the sampler; more than a quarter of a half tooth, a
// gap, a restart, a reversal empties everything and the monitor learns anew. A faulty sample is a
// signal fault until the next verdict.
// Delay: 2.3 revolutions in the median, nine in ten within 2.75; two are the proof itself. After a
// restart about 7 revolutions of learning.
// Cost on Cortex-M4F with three teeth: 255 instructions on average; 120 in a sample without work,
// up to 410 in the six after a half tooth, twice that when the evidence is copied as well.
// Range: 2 teeth up to the capacity; at least eight servo samples a tooth; |torque| < 1e9 Nm.
// Numerical bound: that of the lattice; nothing else has a memory beyond four revolutions.
// Bad at: one tooth; breakage outside the cut or right at its end; loss of less than about a tenth
// of a tooth's load; two simultaneous breaks that leave a pattern of equal teeth; slow wear.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/core/whole.hpp"
#include "servosense/dsp/angle_sampler.hpp"
#include "servosense/dsp/lattice_ar.hpp"
#include "servosense/dsp/moving_threshold.hpp"
#include "servosense/dsp/repeated_change.hpp"
#include "servosense/monitors/evidence.hpp"
#include "servosense/monitors/monitor.hpp"

namespace servosense {

struct ArBreakageConfig {
  double sample_period_s = 125e-6;
  unsigned teeth = 4;              ///< m
  double noise_Nm = 0;             ///< standard deviation of the mean torque over a tooth period
                                   ///< with the spindle idling, learned; 0 = off, monitor idles
  double minimum_speed_rad_s = 5;  ///< slower than this the monitor idles
  unsigned order_revolutions = 2;  ///< length of the AR model: 2 (Bertok 1984, 3.3.2.3)
  double memory_revolutions = 10;  ///< time constant of forgetting
  unsigned residual_window = 10;   ///< n
  double residual_ratio = 4;       ///< R that makes a change sudden
  double repetition_limit = 2.5;   ///< a pattern that grows evenly reaches 1
  double steadiness_limit = 0.5;   ///< least level over greatest, of four revolutions
  double share_threshold = 0.1;    ///< of the usual mean torque of a tooth
  double warning_fraction = 0.75;
  double release_fraction = 0.5;
  unsigned release_revolutions = 4;
  unsigned stages_per_sample = 4;
};

/// MaxTeeth: capacity; the AR model has room for two revolutions of that many teeth.
template <RealNumber Real, std::size_t MaxTeeth = 8>
class ArBreakageMonitor {
 public:
  using Config = ArBreakageConfig;
  static constexpr unsigned kPartsPerTooth = 2;
  static constexpr std::size_t kMaxOrder = std::size_t{2} * kPartsPerTooth * MaxTeeth;
  static constexpr std::size_t kMaxWindow = 32;
  /// Residuals that R judges together: a broken tooth upsets its own period and the next.
  static constexpr unsigned kJudged = 2 * kPartsPerTooth;
  /// Angle samples: an alarm and the four revolutions before it, whatever the alignment.
  static constexpr std::size_t kEvidenceStride = std::size_t{5} * kPartsPerTooth * MaxTeeth;

  /// One half tooth, as the detector sees it and an alarm is replayed from.
  struct Input {
    Real torque_Nm = 0;
    bool first = false;  ///< nothing goes before it: learn anew
  };
  /// Everything that decides, from angle samples on.
  class Core {
   public:
    struct State {
      MonitorState state = MonitorState::idle;
      SignalState signal = SignalState::filling;
      Real value = 0;     ///< share of a tooth's torque that moved, 0 unless it was an event
      Real usual_Nm = 0;  ///< highest level of a revolution, forgotten as the model forgets
      Real tooth_Nm = 0;  ///< mean torque of the newest tooth
      Real residual_Nm = 0;
      Real ratio_squared = 0;      ///< R^2 of the newest residuals
      std::uint32_t samples = 0;   ///< half teeth since the start; stops when learnt
      std::uint32_t pairing = 0;   ///< of the tooth judged last: even or odd halves first
      std::uint32_t outliers = 0;  ///< residuals beyond all cutting: learnt anew
      std::uint32_t skip = 0;      // half teeth not to learn from
      Real last_Nm = 0;            // the half tooth before
      std::uint32_t next_ratio = 0;
      std::array<Real, 2 * kMaxOrder> ratios_squared{};  // one a half tooth, a ring
    };

    void configure(const Config& c) noexcept {
      const auto parts = static_cast<double>(c.teeth * kPartsPerTooth);
      const double noise = c.noise_Nm > 0 ? c.noise_Nm : 1;
      const double forgetting = 1 - 1 / (c.memory_revolutions * parts);
      lattice_.configure({c.order_revolutions * c.teeth * kPartsPerTooth,
                          noise * noise * kPartsPerTooth, forgetting});
      forgetting_ = static_cast<Real>(forgetting);
      threshold_.configure({c.residual_window, noise * 1.4142135623730951, kJudged});
      for (auto& change : change_) change.configure({c.teeth, noise});
      alarm_.configure({c.noise_Nm > 0 ? c.share_threshold : 0.0, c.warning_fraction,
                        c.release_fraction, c.release_revolutions * c.teeth * kPartsPerTooth, 1});
      ratio_ = static_cast<Real>(c.residual_ratio * c.residual_ratio);
      repetition_ = static_cast<Real>(c.repetition_limit);
      steadiness_ = static_cast<Real>(c.steadiness_limit);
      ring_ = 4 * c.teeth * kPartsPerTooth;
      // Residuals mean nothing before p samples (Bertok 1984, fig. 3.5), and the revolution of a
      // change lies up to 2.5 revolutions back.
      warm_ = lattice_.order() + c.residual_window + kJudged - 1;
      learnt_ = warm_ + 3 * c.teeth * kPartsPerTooth;
      state_ = State{};
    }
    void reset() noexcept {
      forget();
      alarm_.reset();
      state_ = State{};
    }
    /// Takes a half tooth; process_some() does the work. Requires that nothing is pending.
    void begin(const Input& in) noexcept {
      if (in.first && state_.samples > 0) forget();
      torque_ = in.torque_Nm;
      lattice_.begin(in.torque_Nm);
      step_ = lattice_.state().held ? Step::none : Step::predict;
    }
    [[nodiscard]] bool pending() const noexcept { return step_ != Step::none; }
    /// One step of the work: so many stages of the lattice, or one of what follows it. True when it
    /// has raised an alarm.
    bool process_some(std::uint32_t stages) noexcept {
      switch (step_) {
        case Step::none:
          return false;
        case Step::predict:
          if (lattice_.process_some(stages)) step_ = Step::take;
          return false;
        case Step::take:
          step_ = take(lattice_.state().residual) ? Step::compare : Step::none;
          return false;
        case Step::compare:
          change_[state_.pairing].compare();
          step_ = Step::decide;
          return false;
        case Step::decide:
          break;
      }
      step_ = Step::none;
      return decide();
    }
    MonitorState judge(SignalState signal) noexcept {
      state_.signal = signal;
      return state_.state = alarm_.process(state_.value, signal);
    }
    /// Learns anew; the alarm logic keeps its configuration and counts.
    void forget() noexcept {
      State& s = state_;
      lattice_.reset();
      threshold_.reset();
      for (auto& change : change_) change.reset();
      step_ = Step::none;
      s.samples = s.pairing = 0;
      s.value = s.usual_Nm = 0;
    }

    [[nodiscard]] const State& state() const noexcept { return state_; }
    [[nodiscard]] const auto& lattice() const noexcept { return lattice_.state(); }
    /// Of the pairing judged last.
    [[nodiscard]] const auto& change() const noexcept { return change_[state_.pairing].state(); }
    [[nodiscard]] const AlarmLogic<Real>& alarm() const noexcept { return alarm_; }
    /// Largest R^2 in the revolution of the change judged last, B of the comparison, and the tooth
    /// after it, in which the level still moves.
    [[nodiscard]] Real event_ratio_squared() const noexcept {
      const State& s = state_;
      const auto& change = change_[s.pairing];
      const std::uint32_t m = change.teeth();
      std::uint32_t at = s.next_ratio + ring_ - kPartsPerTooth * (change.lag() + 2 * m);
      if (at >= ring_) at -= ring_;
      Real event = 0;
      for (std::uint32_t i = 0; i < kPartsPerTooth * (m + 1); ++i) {
        if (s.ratios_squared[at] > event) event = s.ratios_squared[at];
        at = at + 1 == ring_ ? 0 : at + 1;
      }
      return event;
    }

   private:
    enum class Step : std::uint8_t { none, predict, take, compare, decide };

    // True when there is something to compare.
    bool take(Real residual) noexcept {
      State& s = state_;
      s.residual_Nm = residual;
      const Real together = kTogether * threshold_.process(residual);
      const Real alone = threshold_.state().newest_squared;
      s.ratio_squared = alone > together ? alone : together;
      if (alone > kOutlier || s.skip > 0) {
        // It would rule the model for a hundred revolutions, and reaches over the edge it lies on.
        s.outliers += s.skip == 0;
        s.skip = s.skip == 0 ? 2 : s.skip - 1;
        forget();
        judge(SignalState::filling);
        return false;
      }
      if (s.samples < learnt_) ++s.samples;
      if (s.samples < warm_) s.ratio_squared = 0;
      s.ratios_squared[s.next_ratio] = s.ratio_squared;
      s.next_ratio = s.next_ratio + 1 == ring_ ? 0 : s.next_ratio + 1;
      s.tooth_Nm = Real(0.5) * (s.last_Nm + torque_);
      s.last_Nm = torque_;
      s.pairing ^= 1U;
      auto& change = change_[s.pairing];
      const bool full = s.samples > 1 && change.add(s.tooth_Nm);
      if (full && s.samples >= learnt_) return true;
      if (full) change.compare();
      judge(SignalState::filling);
      return false;
    }

    bool decide() noexcept {
      State& s = state_;
      const auto& c = change();
      s.usual_Nm *= forgetting_;
      if (c.level_Nm > s.usual_Nm) s.usual_Nm = c.level_Nm;
      // The search comes last: it is hardly ever needed.
      const bool breakage = c.repetition >= repetition_ && c.steadiness >= steadiness_ &&
                            c.share > c.explained && c.level_Nm >= steadiness_ * s.usual_Nm &&
                            event_ratio_squared() >= ratio_;
      s.value = breakage ? (c.share - c.explained) * (c.level_Nm / s.usual_Nm) : Real(0);
      const MonitorState before = s.state;
      return judge(SignalState::good) == MonitorState::alarm && before != MonitorState::alarm;
    }

    // Of noise alone, four residuals are together as seldom beyond 6 as one is beyond 4.
    static constexpr Real kTogether = Real(16.0 / 36.0);
    // A residual of 1000 times those before it: no cut does that to a model that knows it; the
    // first touch out of still air may, and then learning anew costs nothing.
    static constexpr Real kOutlier = Real(1e6);

    LatticeAr<Real, kMaxOrder> lattice_;
    MovingThreshold<Real, kMaxWindow, kJudged> threshold_;
    std::array<RepeatedChange<Real, MaxTeeth>, kPartsPerTooth> change_;
    AlarmLogic<Real> alarm_;
    State state_;
    Real torque_ = 0;
    Real forgetting_ = 1;
    Real ratio_ = 0;
    Real repetition_ = 0;
    Real steadiness_ = 0;
    std::uint32_t ring_ = 1;
    std::uint32_t warm_ = 0;
    std::uint32_t learnt_ = 0;
    Step step_ = Step::none;
  };
  using Recorder = EvidenceRecorder<Core, Input, kEvidenceStride>;
  using Evidence = typename Recorder::Evidence;

  struct State {
    MonitorState state = MonitorState::idle;
    std::uint64_t sample = 0;        ///< number of the newest sample
    std::uint64_t alarms = 0;        ///< times `state` became `alarm`
    std::uint64_t alarm_sample = 0;  ///< sample that raised the last one; 0 before the first
    std::uint64_t faults = 0;        ///< samples not used
    std::uint64_t restarts = 0;      ///< times everything was learnt anew
    std::uint32_t waiting = 0;       ///< samples since the last half tooth
    std::uint32_t breaks = 0;        // restarts of the sampler, as last seen
    std::uint32_t left_out = 0;      // samples it left out of the part that fills, likewise
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (c.teeth < 2 || c.teeth > MaxTeeth)
      return Status::invalid("teeth", "must be within 2 and the block's capacity");
    if (!(c.noise_Nm == 0 || (c.noise_Nm > 1e-9 && c.noise_Nm < 1e9)))
      return Status::invalid("noise_Nm", "must be zero (off) or within 1e-9 and 1e9 Nm");
    const double step = c.minimum_speed_rad_s * c.sample_period_s;
    if (!(step > 1e-7 && step < kTwoPi / 16))
      return Status::invalid("minimum_speed_rad_s",
                             "must turn the spindle by 1e-7 rad to a sixteenth turn a sample");
    if (c.order_revolutions < 1 || c.order_revolutions > 2)
      return Status::invalid("order_revolutions", "must be 1 or 2");
    if (!(c.memory_revolutions >= 3 && c.memory_revolutions <= 1e4))
      return Status::invalid("memory_revolutions", "must be within 3 and 10000");
    if (c.residual_window < 2 || c.residual_window > kMaxWindow)
      return Status::invalid("residual_window", "must be within 2 and 32");
    if (!(c.residual_ratio > 0 && is_finite(c.residual_ratio)))
      return Status::invalid("residual_ratio", "must be positive");
    if (!(c.repetition_limit > 0 && is_finite(c.repetition_limit)))
      return Status::invalid("repetition_limit", "must be positive");
    if (!(c.steadiness_limit > 0 && c.steadiness_limit < 1))
      return Status::invalid("steadiness_limit", "must be within 0 and 1");
    if (c.release_revolutions < 1 || c.release_revolutions > 100000)
      return Status::invalid("release_revolutions", "must be within 1 and 100000");
    if (c.stages_per_sample < 1) return Status::invalid("stages_per_sample", "must be at least 1");
    const Status s = AlarmLogic<Real>::validate(
        {c.share_threshold, c.warning_fraction, c.release_fraction, 1, 1});
    return s.ok() || s.parameter()[0] != 't' ? s : Status::invalid("share_threshold", s.reason());
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    const unsigned parts = c.teeth * kPartsPerTooth;
    sampler_.configure({parts, 0});
    core_.configure(c);
    stages_ = c.stages_per_sample;
    const double slowest = kTwoPi / (parts * c.minimum_speed_rad_s * c.sample_period_s);
    slowest_ = whole(slowest + 1);
    reset();
  }
  void reset() noexcept {
    sampler_.reset();
    core_.reset();
    recorder_.reset();
    state_ = State{};
    first_ = true;
  }

  /// Estimated cutting torque, positive against the rotation when that is positive; spindle angle
  /// [0, 2 pi]; its increment since the last sample; what is known against either.
  MonitorState process(Real torque_Nm, Real turn_angle_rad, Real increment_rad,
                       Quality quality) SERVOSENSE_NONBLOCKING {
    const bool number = torque_Nm < kMost && torque_Nm > -kMost && is_finite(increment_rad);
    if (!number) quality |= Quality::invalid;
    const bool complete = sampler_.process(torque_Nm, turn_angle_rad, quality);
    const auto& sampler = sampler_.state();
    if (!complete) return rest(sampler, quality);
    const auto& part = sampler.part;
    return hear(sampler, quality,
                {part.mean[0], part.direction, part.samples, part.left_out, part.in_a_row == 1});
  }
  /// The same from the quarters of tooth periods that another block has sampled already, the torque
  /// its first signal: `sampler` after this sample, and whether that has completed a quarter. Two
  /// of them are a half. Not to be mixed with process().
  template <std::size_t Signals>
  MonitorState follow(const typename AngleSampler<Real, Signals>::State& sampler, bool complete,
                      Quality quality) SERVOSENSE_NONBLOCKING {
    if (!complete) return rest(sampler, quality);
    const auto& part = sampler.part;
    const Half before = before_;
    before_ = {part.mean[0], part.direction, part.samples, part.left_out, false};
    const std::uint32_t last = part.direction > 0 ? 1 : 0;  // quarter of its half
    if (part.in_a_row < 2 || part.index % 2 != last) return rest(sampler, quality);
    return hear(
        sampler, quality,
        {Real(0.5) * (before.torque_Nm + part.mean[0]), part.direction,
         before.samples + part.samples, before.left_out + part.left_out, part.in_a_row < 4});
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  [[nodiscard]] const Core& core() const noexcept { return core_; }
  [[nodiscard]] const auto& sampler() const noexcept { return sampler_.state(); }

  /// What the last alarm was raised from, the last input raising it. Off the real-time path.
  [[nodiscard]] Evidence evidence() const noexcept { return recorder_.evidence(); }
  /// Raises the alarm of `e` again, bit for bit; the state after its last input.
  static MonitorState replay(const Evidence& e, Core& core) noexcept {
    core = e.before;
    for (std::uint32_t i = 0; i < e.count; ++i) {
      core.begin(e.inputs[i]);
      while (core.pending()) core.process_some(kMaxOrder);
    }
    return core.state().state;
  }

 private:
  static constexpr Real kMost = Real(1e9);

  // A half of a tooth period as the sampler gives it.
  struct Half {
    Real torque_Nm = 0;
    std::int32_t direction = 1;
    std::uint32_t samples = 0;
    std::uint32_t left_out = 0;
    bool first = false;  // no half goes before it
  };

  // This sample has completed a half.
  template <typename Sampler>
  MonitorState hear(const Sampler& sampler, Quality quality, const Half& half) noexcept {
    ++state_.sample;
    return hear_in_full(sampler.restarts, sampler.running, sampler.left_out, quality, &half);
  }
  // It has completed none.
  template <typename Sampler>
  [[gnu::always_inline]] MonitorState rest(const Sampler& sampler, Quality quality) noexcept {
    State& s = state_;
    ++s.sample;
    if (sampler.running && sampler.restarts == s.breaks && sampler.left_out <= s.left_out) {
      s.left_out = sampler.left_out;
      if (core_.pending())
        work(stages_);
      else
        recorder_.prepare(core_);
      return wait();
    }
    return hear_in_full(sampler.restarts, sampler.running, sampler.left_out, quality, nullptr);
  }

  [[gnu::noinline]] MonitorState hear_in_full(std::uint32_t restarts, bool running,
                                              std::uint32_t left_out, Quality quality,
                                              const Half* half) noexcept {
    State& s = state_;
    const bool left = left_out > s.left_out;
    s.left_out = left_out;
    if (restarts != s.breaks) {
      s.breaks = restarts;
      return learn_anew(has(quality, Quality::gap) ? SignalState::faulty : SignalState::filling);
    }
    if (half == nullptr) {
      if (core_.pending()) work(stages_);
      if (has(quality, Quality::gap)) return judge(SignalState::faulty);
      if (!running && has(quality, Quality::settling)) return judge(SignalState::filling);
      if (running && !left) return wait();
      ++s.faults;
      return judge(SignalState::faulty);
    }
    s.waiting = 0;
    // Too fast for the steps to keep pace: the rest at once.
    while (core_.pending()) work(kMaxOrder);
    if (half->left_out * 4 > half->samples + half->left_out) return learn_anew(SignalState::faulty);
    const Input in{half->direction > 0 ? half->torque_Nm : -half->torque_Nm, first_ || half->first};
    if (in.first && !first_) ++s.restarts;
    first_ = false;
    recorder_.before(core_, in);
    core_.begin(in);
    if (in.first) judge(SignalState::filling);
    return s.state;
  }

  MonitorState judge(SignalState signal) noexcept {
    recorder_.discard();
    return state_.state = core_.judge(signal);
  }

  MonitorState learn_anew(SignalState signal) noexcept {
    if (!first_) ++state_.restarts;
    first_ = true;
    state_.waiting = 0;
    core_.forget();
    return judge(signal);
  }

  void work(std::uint32_t stages) noexcept {
    State& s = state_;
    if (core_.process_some(stages)) {
      ++s.alarms;
      s.alarm_sample = s.sample;
      recorder_.freeze();
    }
    s.state = core_.state().state;
  }

  [[gnu::always_inline]] MonitorState wait() noexcept {
    State& s = state_;
    if (s.waiting < slowest_ && s.state != MonitorState::idle) {  // almost always
      ++s.waiting;
      return s.state;
    }
    return wait_in_full();
  }
  [[gnu::noinline]] MonitorState wait_in_full() noexcept {
    State& s = state_;
    if (s.waiting < slowest_) {
      ++s.waiting;
      if (s.state == MonitorState::idle && core_.state().signal == SignalState::filling)
        return judge(SignalState::filling);
    } else if (core_.state().signal != SignalState::standstill) {
      learn_anew(SignalState::standstill);
      s.waiting = slowest_;
    }
    return s.state;
  }

  AngleSampler<Real> sampler_;
  Half before_;  // the quarter before, when following
  Core core_;
  Recorder recorder_;
  State state_;
  std::uint32_t stages_ = 4;
  std::uint32_t slowest_ = 1;
  bool first_ = true;
};

}  // namespace servosense
