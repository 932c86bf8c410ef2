// Drill fracture, from the lateral force that turns with the spindle.
//
// Purpose: says while a hole is drilled whether a lip of the drill has broken off. The lateral
// forces of an intact drill cancel; a broken lip leaves a force that turns with the tool (Koike
// 2016, sec. 2.3.4 and ch. 6). Torque and thrust carry no such mark: thrust only says when there is
// a hole. Equation: radius of the rotational filter (dsp/rotational_filter.hpp, order N = 500,
// Hann) on the disturbance forces of X and Y, observers at 3500 rad/s; value = its mean over the
// last `average_s` = 0.4 s inside the hole [N]; alarm at the threshold. The source tells an intact
// drill from a broken one by the ratio of these means; its table 6-2 is the reason for the
// threshold rule below. Threshold: 1.5 times the highest value of the holes drilled with an intact
// tool, or their mean + 6 sigma if that is more (IdleStatistics over `hole_N`). In the source's
// table 6-2 the weakest hole of every fractured drill but one (C008, 0.5 mm2) reaches 1.69 times
// the strongest intact hole or more.
// Discretisation: parts of average_s / 16; a verdict after each. A part belongs to a hole when the
// mean thrust over it reaches `drilling_thrust_N` and the spindle turns. From its beginning the
// filter's window and `entry_s` have to pass, then 16 parts.
// Delay: first verdict window + entry_s + average_s after the drill enters, rounded up to parts,
// and up to one part more: 0.525 to 0.55 s with these defaults. A fracture within a hole that
// multiplies the value by q is found after (N-1)/2 samples and about average_s (t - 1) / (q - 1), t
// the threshold as a multiple of the value before, and up to one part.
// Cost on Cortex-M4F: 229 instructions with a Hann window, 548 for the worst sample, whatever N and
// average_s.
// Range: from minimum_speed_rad_s (three turns in the window, so that neither friction errors nor
// feed forces reach the result) up to an eighth of a turn a sample. |force| < 1e15 N.
// Numerical bound: as the filter, N u / 2 of the largest force; nothing drifts in 24 h.
// Bad at: holes shorter than the first verdict (`short_holes` counts them); chipped outer corners
// below about 1 mm2; a bent shank or a run-out that pushes the tool round at spindle speed (it is
// what the threshold was taught on, unless it grows); one axis alone.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/core/whole.hpp"
#include "servosense/dsp/rotational_filter.hpp"
#include "servosense/monitors/evidence_ring.hpp"
#include "servosense/monitors/monitor.hpp"

namespace servosense {

struct DrillFractureConfig {
  double sample_period_s = 125e-6;
  unsigned window_samples = 500;  ///< N, order of the rotational filter
  CosineWindow window = CosineWindow::hann;
  /// How a force that turns with the tool turns in x and y while the spindle angle grows:
  /// counter-clockwise where one of the three counts the other way round.
  Rotation rotation = Rotation::clockwise;
  double minimum_speed_rad_s = 302;  ///< slower than this the monitor idles
  double drilling_thrust_N = 0;      ///< thrust that means drilling; 0 = whenever the spindle turns
  double entry_s = 0.05;             ///< of a hole, besides the filter's window, not judged
  double average_s = 0.4;            ///< over which the radius is averaged
  double threshold_N = 0;            ///< 0 = off, the monitor idles
  double warning_fraction = 0.75;    ///< of the threshold
  double release_fraction = 0.5;     ///< of the threshold
  unsigned release_verdicts = 4;     ///< below the release level before an alarm ends
  unsigned consecutive_verdicts = 1;  ///< at or above a level that raise it; they overlap
  double tolerated_stand_ins = 0.02;  ///< part of a sixteenth of average_s that may be replaced
};

/// One sample as the filter takes it; what an alarm is replayed from. For an invalid one stands
/// what rotates, at the angle 0.
template <RealNumber Real>
struct DrillFractureSample {
  Real force_x_N = 0;
  Real force_y_N = 0;
  Real angle_rad = 0;
};

/// Everything besides the samples that an alarm is replayed from.
template <RealNumber Real>
struct DrillFractureEvidence {
  std::uint64_t sample = 0;       ///< number of the sample that raised the alarm
  std::uint32_t count = 0;        ///< samples to replay; the last one raised the alarm
  std::uint32_t part = 0;         ///< of these, the newest ones, the newest part of the average
  std::array<Real, 16> part_N{};  ///< ring of the parts' mean radii
  std::uint32_t newest_part = 0;  ///< the one there that follows from the samples
  Real value_N = 0;
  AlarmLogic<Real> alarm;  ///< as it was before the alarm
};

/// Window: largest N. KeptSamples: samples that are kept as evidence; an alarm needs twice the
/// window and a part (1200 with the defaults), else it is raised without.
template <RealNumber Real, std::size_t Window, std::size_t KeptSamples>
class DrillFractureMonitor {
  static_assert(Window >= 8 && KeptSamples >= 1);

 public:
  using Config = DrillFractureConfig;
  using Sample = DrillFractureSample<Real>;
  using Evidence = DrillFractureEvidence<Real>;
  using Filter = RotationalFilter<Real, Window>;
  static constexpr std::size_t kParts = 16;  ///< of the average
  /// Samples after an alarm within which its evidence must be copied.
  static constexpr std::size_t kReadoutSamples = EvidenceRing<Sample, KeptSamples>::kReadout;

  struct State {
    MonitorState state = MonitorState::idle;
    SignalState signal = SignalState::filling;
    Real value_N = 0;      ///< mean radius over average_s, of the last verdict
    Real radius_N = 0;     ///< every eighth sample of a part, drilling or not
    Real thrust_N = 0;     ///< magnitude of its mean over the last part
    Real speed_rad_s = 0;  ///< likewise
    Real hole_N = 0;       ///< highest value of the hole completed last: what is taught
    std::uint64_t sample = 0;
    std::uint64_t holes = 0;            ///< completed, with at least one verdict
    std::uint64_t short_holes = 0;      ///< completed without
    std::uint64_t stand_ins = 0;        ///< invalid samples not used
    std::uint64_t restarts = 0;         ///< times the filter began anew
    std::uint64_t alarms = 0;           ///< times `state` became `alarm`
    bool drilling = false;              ///< the last part belonged to a hole
    std::uint32_t parts = 0;            ///< of the present hole so far, stops where verdicts begin
    std::array<Real, kParts> part_N{};  ///< ring of the parts' mean radii
    std::uint32_t next_part = 0;
    Real hole_peak_N = 0;
    bool judged = false;  ///< the present hole has had a verdict
    struct {              ///< the part that fills
      std::uint32_t samples = 0;
      std::uint32_t stand_ins = 0;
      Real radius = 0;
      Real thrust = 0;
      Real turned_rad = 0;
    } part;
    Real last_angle_rad = -1;  ///< below zero: none
    Real last_thrust_N = 0;
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0 && c.sample_period_s <= 1))
      return Status::invalid("sample_period_s", "must be positive, 1 s at most");
    if (const Status s = Filter::validate(filter(c)); !s.ok()) return s;
    const double turns =
        c.minimum_speed_rad_s * c.sample_period_s * static_cast<double>(c.window_samples) / kTwoPi;
    if (!(turns >= 2.99))
      return Status::invalid("minimum_speed_rad_s",
                             "must turn the spindle three times within window_samples");
    if (!(c.minimum_speed_rad_s * c.sample_period_s < kTwoPi / 8))
      return Status::invalid("minimum_speed_rad_s", "must stay below an eighth of a turn a sample");
    if (!(c.drilling_thrust_N >= 0 && is_finite(c.drilling_thrust_N)))
      return Status::invalid("drilling_thrust_N", "must be zero (none) or a positive number");
    if (!(c.entry_s >= 0 && c.entry_s <= 100))
      return Status::invalid("entry_s", "must be within 0 and 100");
    if (!(c.average_s >= 4 * kParts * c.sample_period_s && c.average_s <= 100))
      return Status::invalid("average_s", "must be within 64 samples and 100 s");
    if (!(c.tolerated_stand_ins >= 0 && c.tolerated_stand_ins <= 1))
      return Status::invalid("tolerated_stand_ins", "must be within 0 and 1");
    if (c.release_verdicts < 1) return Status::invalid("release_verdicts", "must be at least 1");
    if (c.consecutive_verdicts < 1)
      return Status::invalid("consecutive_verdicts", "must be at least 1");
    const Status s = AlarmLogic<Real>::validate(logic(c));
    return s.ok() || s.parameter()[0] != 't' ? s : Status::invalid("threshold_N", s.reason());
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    filter_.configure(filter(c));
    alarm_.configure(logic(c));
    part_samples_ = nearest_whole(c.average_s / (kParts * c.sample_period_s));
    part_inverse_ = static_cast<Real>(1.0 / part_samples_);
    // The filter lets through so little that its radius hardly moves within an eighth of the part
    // of the window that this is.
    every_ = part_samples_ >= kEvery * 8 && c.window_samples >= kEvery * 16 ? kEvery : 1;
    const std::uint32_t radii = part_samples_ / every_;
    radius_inverse_ = static_cast<Real>(1.0 / radii);
    rate_ = static_cast<Real>(1.0 / c.sample_period_s);
    slowest_rad_s_ = static_cast<Real>(c.minimum_speed_rad_s);
    mirror_ = c.rotation == Rotation::clockwise ? Real(1) : Real(-1);
    drilling_thrust_ = static_cast<Real>(c.drilling_thrust_N);
    tolerated_ = whole(c.tolerated_stand_ins * part_samples_);
    const double skipped = c.window_samples + c.entry_s / c.sample_period_s;
    skipped_parts_ = whole(skipped / part_samples_ + 1);
    reset();
  }
  void reset() noexcept {
    filter_.reset();
    alarm_.reset();
    state_ = State{};
    evidence_ = Evidence{};
  }

  /// One servo period: disturbance forces of the two lateral axes and of the one that feeds the
  /// drill (of either sign; not read when drilling_thrust_N is 0), spindle angle within the turn
  /// [0, 2 pi), its increment since the last sample, and what is known against any of them.
  MonitorState process(Real force_x_N, Real force_y_N, Real thrust_N, Real turn_angle_rad,
                       Real increment_rad, Quality quality) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    ++s.sample;
    // Almost every sample: sound, and the angle where the last one led to.
    const Real beyond = turn_angle_rad - s.last_angle_rad - increment_rad;
    if (!has(quality, kBreaks | kUnusable) && s.last_angle_rad >= 0 &&
        std::abs(beyond) <= kTurn / 16 && fits(force_x_N, force_y_N, thrust_N) &&
        fits_turn_of(turn_angle_rad, increment_rad))
      return hear({force_x_N, force_y_N, turn_angle_rad}, thrust_N, increment_rad);
    return process_in_full({force_x_N, force_y_N, turn_angle_rad}, thrust_N, increment_rad,
                           quality);
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  [[nodiscard]] const AlarmLogic<Real>& alarm() const noexcept { return alarm_; }
  [[nodiscard]] const Filter& filter() const noexcept { return filter_; }

  /// What the last alarm was raised from; count = 0 before the first, or when KeptSamples was too
  /// small.
  [[nodiscard]] const Evidence& evidence() const noexcept { return evidence_; }
  /// Copies the samples of `evidence()` to `out`, oldest first; returns how many. 0 when there are
  /// none, `out` is too small, or more than kReadoutSamples have come since.
  std::size_t copy_evidence(std::span<Sample> out) const noexcept {
    return kept_.copy(evidence_.count, state_.sample - evidence_.sample, out);
  }
  /// Raises the alarm of `e` again from the samples that copy_evidence gave, bit for bit, with the
  /// last sample. Off the real-time path. Requires configure() with the configuration of the alarm.
  MonitorState replay(const Evidence& e, std::span<const Sample> samples) noexcept {
    reset();
    alarm_ = e.alarm;
    state_.part_N = e.part_N;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      if (i + e.part == e.count) state_.part = {};
      take(samples[i]);
    }
    if (samples.size() < e.count) return state_.state;
    state_.part_N[e.newest_part] = state_.part.radius * radius_inverse_;
    return give_verdict();
  }

 private:
  static constexpr Real kTurn = static_cast<Real>(kTwoPi);
  static constexpr std::uint32_t kEvery = 8;
  static constexpr Quality kBreaks = Quality::restarted | Quality::gap | Quality::settling;

  static RotationalFilterConfig filter(const Config& c) noexcept {
    return {c.window_samples, c.window, c.rotation};
  }
  static AlarmLogicConfig logic(const Config& c) noexcept {
    return {c.threshold_N, c.warning_fraction, c.release_fraction, c.release_verdicts,
            c.consecutive_verdicts};
  }

  [[nodiscard]] bool fits(Real x, Real y, Real thrust) const noexcept {
    return x * x + y * y < Real(1e30) && (!(drilling_thrust_ > 0) || fits_window(thrust));
  }
  static bool fits_turn_of(Real angle, Real increment) noexcept {
    return angle >= 0 && angle <= kTurn && std::abs(increment) <= kTurn / 8;
  }

  MonitorState hear(const Sample& in, Real thrust, Real increment) noexcept {
    State& s = state_;
    s.last_angle_rad = in.angle_rad;
    s.last_thrust_N = thrust;
    s.part.turned_rad += increment;
    take(in);
    if (s.part.samples == part_samples_) complete_part();
    return s.state;
  }

  [[gnu::noinline]] MonitorState process_in_full(const Sample& in, Real thrust, Real increment,
                                                 Quality quality) noexcept {
    State& s = state_;
    if (has(quality, kBreaks)) {
      begin_anew();
      if (has(quality, Quality::gap)) return judge(SignalState::faulty);
      if (has(quality, Quality::settling)) return judge(SignalState::filling);
    }
    if (!has(quality, kUnusable) && fits_turn_of(in.angle_rad, increment) &&
        fits(in.force_x_N, in.force_y_N, thrust)) {
      if (jumped(in.angle_rad, increment)) begin_anew();
      return hear(in, thrust, increment);
    }
    ++s.stand_ins;
    ++s.part.stand_ins;
    s.last_angle_rad = -1;  // the next one may be anywhere
    take(stand_in());
    if (s.part.samples == part_samples_) complete_part();
    return judge(SignalState::faulty);
  }

  static Real magnitude(Real x) noexcept { return x < 0 ? -x : x; }

  // The angle and its increment disagree by more than a sixteenth of a turn.
  [[nodiscard]] bool jumped(Real angle, Real increment) const noexcept {
    if (state_.last_angle_rad < 0) return false;
    Real beyond = angle - state_.last_angle_rad - increment;
    if (beyond > kTurn / 2) beyond -= kTurn;
    if (beyond < -kTurn / 2) beyond += kTurn;
    return beyond > kTurn / 16 || beyond < -kTurn / 16;
  }

  // Forgets the window and the hole, keeps the alarm logic, the counters and the last results.
  [[gnu::noinline]] void begin_anew() noexcept {
    State& s = state_;
    if (s.last_angle_rad >= 0 || s.part.samples > 0) {
      ++s.restarts;
      filter_.reset();
      s.part = {};
      s.parts = 0;
      s.judged = s.drilling = false;
      s.hole_peak_N = 0;
      s.last_angle_rad = -1;
    }
    if (s.state != MonitorState::idle) judge(SignalState::filling);
  }

  // Leaves the result as it is: no fault can raise it.
  [[nodiscard]] Sample stand_in() const noexcept {
    const auto& turning = filter_.state().turning;
    return {turning.x, mirror_ * turning.y, 0};
  }

  void take(const Sample& in) noexcept {
    State& s = state_;
    kept_.push(in);
    filter_.advance(in.force_x_N, in.force_y_N, sine_cosine(in.angle_rad));
    s.part.thrust += s.last_thrust_N;
    if (++s.part.samples % every_ != 0) return;
    s.radius_N = filter_.evaluate();
    s.part.radius += s.radius_N;
  }

  [[gnu::noinline]] void complete_part() noexcept {
    State& s = state_;
    const auto part = s.part;
    s.part = {};
    s.thrust_N = magnitude(part.thrust * part_inverse_);
    const Real turned = magnitude(part.turned_rad);
    const std::uint32_t good = part_samples_ - part.stand_ins;
    s.speed_rad_s = good > 0 ? turned * rate_ / static_cast<Real>(good) : Real(0);
    s.part_N[s.next_part] = part.radius * radius_inverse_;
    s.next_part = (s.next_part + 1) % kParts;
    const bool turns = s.speed_rad_s >= slowest_rad_s_;
    const bool drills = !(drilling_thrust_ > 0) || s.thrust_N >= drilling_thrust_;
    if (part.stand_ins > tolerated_) {
      s.parts = 0;
      judge(SignalState::filling);
      return;
    }
    if (!turns || !drills) {
      end_hole();
      judge(SignalState::standstill);
      return;
    }
    s.drilling = true;
    if (s.parts < skipped_parts_ + kParts) ++s.parts;
    if (s.parts < skipped_parts_ + kParts) {
      judge(SignalState::filling);
      return;
    }
    const AlarmLogic<Real> alarm = alarm_;
    const MonitorState before = s.state;
    give_verdict();
    if (s.state == MonitorState::alarm && before != MonitorState::alarm) keep_evidence(alarm);
  }

  MonitorState give_verdict() noexcept {
    State& s = state_;
    Real sum = 0;
    for (const Real part : s.part_N) sum += part;
    s.value_N = sum * Real(1.0 / kParts);
    if (!s.judged || s.value_N > s.hole_peak_N) s.hole_peak_N = s.value_N;
    s.judged = true;
    return judge(SignalState::good);
  }

  void end_hole() noexcept {
    State& s = state_;
    if (s.judged) {
      s.hole_N = s.hole_peak_N;
      ++s.holes;
    } else if (s.drilling) {
      ++s.short_holes;
    }
    s.judged = s.drilling = false;
    s.hole_peak_N = 0;
    s.parts = 0;
  }

  MonitorState judge(SignalState signal) noexcept {
    state_.signal = signal;
    return state_.state = alarm_.process(state_.value_N, signal);
  }

  void keep_evidence(const AlarmLogic<Real>& alarm) noexcept {
    State& s = state_;
    ++s.alarms;
    Evidence& e = evidence_;
    e.sample = s.sample;
    e.part = part_samples_;
    // Back to the beginning of the part, then to where the ring began anew, then one lap more: from
    // there on the filter is the same whatever came before. A verdict comes later than a window and
    // a part after any restart, so all of it has been.
    const auto n = static_cast<std::uint32_t>(filter_.window_samples());
    const auto place = static_cast<std::uint32_t>(filter_.place());
    e.count = part_samples_ + n + (place + n - part_samples_ % n) % n;
    if (e.count > KeptSamples) e.count = 0;
    e.part_N = s.part_N;
    e.newest_part = (s.next_part + kParts - 1) % kParts;
    e.value_N = s.value_N;
    e.alarm = alarm;
    kept_.mark();
  }

  Filter filter_;
  AlarmLogic<Real> alarm_;
  State state_;
  Evidence evidence_;
  EvidenceRing<Sample, KeptSamples> kept_;
  std::uint32_t part_samples_ = 1;
  std::uint32_t skipped_parts_ = 1;
  std::uint32_t tolerated_ = 0;
  std::uint32_t every_ = 1;  // samples from one radius to the next
  Real part_inverse_ = 1;
  Real radius_inverse_ = 1;
  Real rate_ = 1;
  Real slowest_rad_s_ = 0;
  Real drilling_thrust_ = 0;
  Real mirror_ = 1;
};

}  // namespace servosense
