// Broken tooth, from force, displacement or spindle torque averaged over each
// tooth period.
//
// Purpose: finds a tooth that is lost, within the revolution in which it is
// lost, at any radial immersion and without being told the cut. Works on the
// forces of the feed drives or of a dynamometer (x, y), on the displacement of
// the spindle (x, y), or on the spindle torque alone. Equation (Tarng 1988, ch.
// 4, 5 and 7), a tooth period being 1/m of a turn of the spindle:
//   A    = mean of (x, y) over the last tooth period, less that of the idling
//   spindle (5-11) D    = |A| (4-3, 5-13); torque: A itself Delta(t) = D(t) -
//   D(t - 1 tooth period) (4-4, 5-14) pattern: Delta falls and, one to kReach
//   tooth periods later, rises (7.1); its size = min(-2 Delta(fall),
//   Delta(rise)): of a lone tooth's loss both halves are the same value = size
//   / (0.6 threshold * mean of D + noise), threshold from
//   dsp/tooth_immersion.hpp; alarm at 1
// Where the source leaves a point open, or simulated cuts contradict it
// (docs/tooth-breakage.md):
//   Only new patterns count: the part that `new_fraction` of the alarm needs
//   must be left when Delta of a revolution ago is subtracted. Run-out repeats,
//   a break does not; therefore 0.6 of the threshold will do, a fifth of a lost
//   tooth's pattern at least. A pattern that is no news but lasts
//   `consecutive_revolutions` above the whole threshold is a warning: large
//   run-out, or a tooth lost in the air. The fall comes first: a tooth is
//   missed before its successor takes double. threshold * mean falls slowly
//   (`memory_s`), and nothing counts while the mean is below half of what it
//   was: where the feed stops or the cut ends, run-out is what cuts last. What
//   the mean has grown by since the last revolution is subtracted m times: one
//   tooth may have done it all. Noise of the idle spindle: `noise_factor` times
//   it comes on top of that. D is formed four times a tooth period, so that it
//   does not matter where the teeth are.
//   A break is news to a course that repeats; chatter changes in every
//   revolution. So what is new must exceed 4 sqrt(2) times the rms of what was
//   new in Delta over a revolution up to three tooth periods ago: four times,
//   as with noise (8 sigma, of which news has twice), of a power that may grow
//   to twice since then.
// Teaching (7.2): limits of Delta from a first cycle, instead of the threshold.
// Discretisation: by angle, so nothing depends on the spindle speed or its
// changes. Faults: single bad samples are bridged; more than a quarter of a
// part, a gap, a restart, a reversal empties the windows. A faulty sample is a
// signal fault until the next verdict. Delay: at most m + 3 tooth periods after
// the break: until the tooth is due, m; until its successor has passed, 2;
// where several teeth overlap or it broke while cutting, one more. After a
// restart two revolutions and a tooth period of learning (with m < 4 up to four
// more). Cost on Cortex-M4F: bench/firmware/instructions.csv, tooth_breakage
// (three teeth: 285 on average); 6 m more in each of the two samples after a
// part of the turn is complete. The worst sample has the evidence copied ahead
// or a verdict: 774. Memory (float): 19 kB with the capacities as they are, 11
// kB for eight teeth; most of it evidence. Range: 2 teeth up to the capacity; a
// servo sample a part at least: below 60 / (4 m period) rpm. Numerical bound:
// sums live for one revolution; nothing drifts. Bad at: one tooth; swept angles
// near arcsin(throw / feed), where run-out is a broken tooth; below 15 degrees,
// a tooth that breaks in the middle of its cut and is half lost in each of two
// revolutions; a tooth lost in the air, in the first revolution of an entry or
// after the mean has halved (warning at most); a feed that stops and resumes
// within three tooth periods; sensors that are not flat up to half the tooth
// frequency (Tarng 1988, sec. 5.3); displacement within 0.3 to 2 times a
// resonance, unless the swept angle is told.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/core/whole.hpp"
#include "servosense/dsp/angle_sampler.hpp"
#include "servosense/dsp/limit_pattern.hpp"
#include "servosense/monitors/evidence.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/tooth_pattern.hpp"

namespace servosense {

/// MaxTeeth: capacity. Kept: parts of a tooth (quarters) that an alarm's
/// evidence reaches back at least. Intervals: of the taught cycle.
template <RealNumber Real, std::size_t MaxTeeth = 16, std::size_t Kept = 64,
          std::size_t Intervals = 128>
class ToothBreakageMonitor {
 public:
  using Config = ToothBreakageConfig;
  /// What decides, and what it decides from.
  using Core = ToothPattern<Real, MaxTeeth>;
  using Input = ToothPart<Real>;
  static constexpr unsigned kPartsPerTooth = Core::kPartsPerTooth;
  static constexpr std::size_t kMaxParts = kPartsPerTooth * MaxTeeth;

  enum class Teaching : std::uint8_t { off, teaching, matching };

  using Recorder = EvidenceRecorder<typename Core::Memory, Input, Kept>;
  /// As of the recorder, with the whole core.
  struct Evidence {
    Core before{};
    std::array<Input, 2 * Kept> inputs{};
    std::uint32_t count = 0;
    std::uint64_t sample = 0;
  };

  struct State {
    MonitorState state = MonitorState::idle;
    std::uint64_t sample = 0;        ///< number of the newest sample
    std::uint64_t alarms = 0;        ///< times `state` became `alarm`
    std::uint64_t alarm_sample = 0;  ///< sample that raised the last one; 0 before the first
    std::uint64_t faults = 0;        ///< samples not used
    std::uint64_t restarts = 0;      ///< times the windows were emptied
    std::uint32_t waiting = 0;       ///< samples since the last part
    std::uint32_t breaks = 0;        // restarts of the sampler, as last seen
    std::uint32_t left_out = 0;      // samples it left out of the part that fills, likewise
    Teaching teaching = Teaching::off;
    std::uint32_t interval = 0;       ///< of the taught cycle
    std::uint32_t interval_part = 0;  ///< parts of it that have come
    std::uint32_t runout_parts = 0;   ///< still to be averaged for the idle signal
    bool runout = false;              ///< the idle signal is known and subtracted
  };
  /// Mean of the idle signal in each part of the turn (Tarng 1988, D_xr and
  /// D_yr of 5-11, 5-12).
  struct Runout {
    std::array<Real, kMaxParts> x{};
    std::array<Real, kMaxParts> y{};
    std::array<std::uint32_t, kMaxParts> turns{};
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (c.teeth < 2 || c.teeth > MaxTeeth)
      return Status::invalid("teeth", "must be within 2 and the block's capacity");
    if (!(c.noise == 0 || (c.noise > 1e-12 && c.noise < 1e9)))
      return Status::invalid("noise", "must be zero (off) or within 1e-12 and 1e9");
    if (!(c.sample_noise >= 0 && c.sample_noise < 1e9))
      return Status::invalid("sample_noise", "must be within 0 and 1e9");
    const double step = c.minimum_speed_rad_s * c.sample_period_s;
    if (!(step > 1e-7 && step * c.teeth * kPartsPerTooth < kTwoPi))
      return Status::invalid("minimum_speed_rad_s",
                             "must turn the spindle by 1e-7 rad to a quarter tooth a sample");
    if (!(c.tolerated_throw >= 0.01 && c.tolerated_throw < 1))
      return Status::invalid("tolerated_throw", "must be within 0.01 and 1 feed per tooth");
    if (!(c.swept_angle_rad >= 0 && c.swept_angle_rad <= kPi))
      return Status::invalid("swept_angle_rad", "must be zero (estimate) or within 0 and pi");
    if (!(c.new_fraction > 0 && c.new_fraction <= 1))
      return Status::invalid("new_fraction", "must be within 0 and 1");
    if (!(c.noise_factor > 0 && c.noise_factor < 1e6))
      return Status::invalid("noise_factor", "must be positive");
    if (!(c.memory_s >= c.sample_period_s && c.memory_s <= 1e5))
      return Status::invalid("memory_s", "must be within sample_period_s and 100000 s");
    if (c.release_revolutions < 1 || c.release_revolutions > 100000)
      return Status::invalid("release_revolutions", "must be within 1 and 100000");
    if (c.consecutive_revolutions < 1)
      return Status::invalid("consecutive_revolutions", "must be at least 1");
    if (c.teaching_revolutions < 1 || c.teaching_revolutions > 1000000)
      return Status::invalid("teaching_revolutions", "must be within 1 and 1000000");
    if (!(c.teaching_factor >= 1 && c.teaching_factor < 1e6))
      return Status::invalid("teaching_factor", "must be at least 1");
    return AlarmLogic<Real>::validate({c.threshold, c.warning_fraction, c.release_fraction, 1, 1});
  }
  /// Requires validate(c).ok(). Forgets what was taught and learned.
  void configure(const Config& c) noexcept {
    parts_ = c.teeth * kPartsPerTooth;
    torque_ = c.torque;
    sampler_.configure({parts_, 0});
    torque_sampler_.configure({parts_, 0});
    core_.configure(c);
    interval_ = c.teaching_revolutions * parts_;
    const double slowest = kTwoPi / (parts_ * c.minimum_speed_rad_s * c.sample_period_s);
    slowest_ = whole(slowest + 1);
    runout_ = Runout{};
    limits_.reset();
    reset();
  }
  /// Keeps what was taught and learned.
  void reset() noexcept {
    const bool runout = state_.runout;
    sampler_.reset();
    torque_sampler_.reset();
    sampled_ = false;
    core_.reset();
    recorder_.reset();
    state_ = State{};
    state_.runout = runout;
    first_ = true;
  }

  /// From the next sample on the spindle idles for so many revolutions: their
  /// mean, part by part, is from then on subtracted (displacement: run-out of
  /// the spindle and its target). 0 forgets it. Once for each spindle speed at
  /// which it differs.
  void learn_runout(unsigned revolutions) noexcept {
    runout_ = Runout{};
    state_.runout = false;
    state_.runout_parts = revolutions * parts_;
  }
  /// A cycle begins: `teaching` records its limits anew, `matching` holds it
  /// against them.
  void start_cycle(Teaching mode) noexcept {
    if (mode == Teaching::teaching) limits_.reset();
    state_.teaching = mode;
    state_.interval = state_.interval_part = 0;
  }

  /// Force on the tool or displacement of the spindle; spindle angle [0, 2 pi];
  /// its increment since the last sample; what is known against any of them;
  /// swept angle of the cut, if the program tells it, else 0.
  MonitorState process(Real x, Real y, Real turn_angle_rad, Real increment_rad, Quality quality,
                       Real swept_rad = 0) SERVOSENSE_NONBLOCKING {
    if (!(fits(x) && fits(y) && is_finite(increment_rad))) quality |= Quality::invalid;
    const bool complete = sampler_.process({x, y, x * x + y * y}, turn_angle_rad, quality);
    return hear(sampler_.state(), complete, quality, swept_rad);
  }
  /// Torque of the spindle, positive against the rotation when that is
  /// positive. Not to be mixed with the other.
  MonitorState process(Real torque, Real turn_angle_rad, Real increment_rad, Quality quality,
                       Real swept_rad = 0) SERVOSENSE_NONBLOCKING {
    if (!(fits(torque) && is_finite(increment_rad))) quality |= Quality::invalid;
    sampled_ = torque_sampler_.process({torque, torque * torque}, turn_angle_rad, quality);
    return hear(torque_sampler_.state(), sampled_, quality, swept_rad);
  }

  /// Whether the last torque has completed a quarter of a tooth period, and the
  /// sampler: for others that need the same quarters.
  [[nodiscard]] bool sampled() const noexcept { return sampled_; }
  [[nodiscard]] const auto& torque_sampler() const noexcept { return torque_sampler_.state(); }
  [[nodiscard]] const State& state() const noexcept { return state_; }
  [[nodiscard]] const Core& core() const noexcept { return core_; }
  [[nodiscard]] const Runout& runout() const noexcept { return runout_; }
  [[nodiscard]] const LimitPattern<Real, Intervals>& limits() const noexcept { return limits_; }

  /// What the last alarm was raised from, the last input raising it. Off the
  /// real-time path.
  [[nodiscard]] Evidence evidence() const noexcept {
    const auto recorded = recorder_.evidence();
    Evidence e{core_, recorded.inputs, recorded.count, recorded.sample};
    e.before.restore(recorded.before);
    return e;
  }
  /// Raises the alarm of `e` again, bit for bit; the state after its last
  /// input.
  static MonitorState replay(const Evidence& e, Core& core) noexcept {
    core = e.before;
    for (std::uint32_t i = 0; i < e.count; ++i) {
      core.begin(e.inputs[i]);
      while (core.pending()) core.work();
    }
    return core.state().state;
  }

 private:
  static bool fits(Real x) noexcept { return std::abs(x) < Real(1e9); }

  MonitorState judge(SignalState signal) noexcept {
    recorder_.discard();
    return state_.state = core_.judge(signal);
  }

  // The sampler after this sample, and whether that has completed a part.
  template <typename Sampler>
  [[gnu::always_inline]] MonitorState hear(const Sampler& sampler, bool complete, Quality quality,
                                           Real swept_rad) noexcept {
    State& s = state_;
    ++s.sample;
    if (complete || !sampler.running || sampler.restarts != s.breaks ||
        sampler.left_out > s.left_out)
      return hear_in_full(sampler, complete, quality, swept_rad);
    s.left_out = sampler.left_out;
    if (core_.pending())
      work();
    else
      recorder_.prepare(core_.memory());
    return wait();
  }

  template <typename Sampler>
  [[gnu::noinline]] MonitorState hear_in_full(const Sampler& sampler, bool complete,
                                              Quality quality, Real swept_rad) noexcept {
    State& s = state_;
    const bool left = sampler.left_out > s.left_out;
    s.left_out = sampler.left_out;
    if (sampler.restarts != s.breaks) {
      s.breaks = sampler.restarts;
      return start_anew(has(quality, Quality::gap) ? SignalState::faulty : SignalState::filling);
    }
    if (complete) {
      s.waiting = 0;
      while (core_.pending()) work();  // too fast for one stage a sample
      const auto& part = sampler.part;
      if constexpr (std::tuple_size_v<decltype(part.mean)> == 2)
        return take(part, part.mean[0], Real(0), part.mean[1], swept_rad);
      else
        return take(part, part.mean[0], part.mean[1], part.mean[2], swept_rad);
    }
    if (core_.pending()) work();
    if (has(quality, Quality::gap)) return judge(SignalState::faulty);
    if (!sampler.running && has(quality, Quality::settling)) return judge(SignalState::filling);
    if (sampler.running && !left) return wait();
    ++s.faults;
    return judge(SignalState::faulty);
  }

  MonitorState start_anew(SignalState signal) noexcept {
    if (!first_) ++state_.restarts;
    first_ = true;
    state_.waiting = 0;
    core_.forget();
    return judge(signal);
  }

  void work() noexcept {
    State& s = state_;
    const bool alarm = core_.work();
    if (core_.pending()) return;
    s.state = core_.state().state;
    if (s.teaching == Teaching::teaching && core_.state().signal == SignalState::good)
      limits_.record(s.interval, core_.state().difference);
    if (alarm) {
      ++s.alarms;
      s.alarm_sample = s.sample;
      recorder_.freeze();
    }
  }

  template <typename Part>
  MonitorState take(const Part& part, Real x, Real y, Real square, Real swept_rad) noexcept {
    State& s = state_;
    if (part.left_out * 4 > part.samples + part.left_out) return start_anew(SignalState::faulty);
    if (s.runout_parts > 0) {
      learn(part.index, x, y);
      return start_anew(SignalState::filling);
    }
    Input in;
    in.x = x - runout_.x[part.index];
    in.y = y - runout_.y[part.index];
    // What the signal moves within the part it moves with the idle signal or
    // without.
    const Real within = square - (x * x + y * y);
    in.deviation = within > 0 ? std::sqrt(within) : Real(0);
    if (torque_ && part.direction < 0) in.x = -in.x;
    in.swept_rad = swept_rad;
    in.samples = part.samples;
    if (s.teaching == Teaching::matching) {
      const auto l = limits_.limits(s.interval);
      in.matching = l.taught;
      in.low = l.low;
      in.high = l.high;
    }
    if (s.teaching != Teaching::off && ++s.interval_part >= interval_) {
      s.interval_part = 0;
      s.interval += s.interval < Intervals;
    }
    in.first = first_ || part.in_a_row == 1;
    if (in.first && !first_) ++s.restarts;
    first_ = false;
    recorder_.before(core_.memory(), in);
    core_.begin(in);
    return in.first ? judge(SignalState::filling) : s.state;
  }

  void learn(std::uint32_t index, Real x, Real y) noexcept {
    const auto n = static_cast<Real>(++runout_.turns[index]);
    runout_.x[index] += (x - runout_.x[index]) / n;
    runout_.y[index] += (y - runout_.y[index]) / n;
    if (--state_.runout_parts == 0) state_.runout = true;
  }

  MonitorState wait() noexcept {
    State& s = state_;
    if (s.waiting < slowest_) {
      ++s.waiting;
      if (s.state == MonitorState::idle && core_.state().signal == SignalState::filling)
        return judge(SignalState::filling);
    } else if (core_.state().signal != SignalState::standstill) {
      start_anew(SignalState::standstill);
      s.waiting = slowest_;
    }
    return s.state;
  }

  AngleSampler<Real, 3> sampler_;         // of x, y and their square
  AngleSampler<Real, 2> torque_sampler_;  // of the torque and its square
  Core core_;
  Recorder recorder_;
  LimitPattern<Real, Intervals> limits_;
  Runout runout_;
  State state_;
  std::uint32_t parts_ = 8;
  std::uint32_t interval_ = 1;
  std::uint32_t slowest_ = 1;
  bool torque_ = false;
  bool sampled_ = false;
  bool first_ = true;
};

}  // namespace servosense
