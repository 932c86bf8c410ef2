// Chatter or forced vibration? Power of the cutting torque on and off the spindle's harmonics.
//
// Purpose: two alarms from the estimated cutting torque and the spindle angle: chatter (vibration
// that does not repeat with the revolution) and forced vibration (which does). No chatter frequency
// needed.
// Equation, over a window of the last R whole revolutions, W samples long (Koike 2016, sec. 2.3.3;
// one scale for both, which the source leaves open):
//   total   = variance of the torque
//   forced  = sum over h = 1..H of 2 |M_h|^2 / W^2, M_h = sum of torque e^(-j h angle)
//   residue = max(0, total - forced)                                                    [Nm^2]
// A sinusoid of amplitude A puts A^2 / 2 into exactly one of the two. But whatever changes in the
// cut is residue too, so another power is judged, once a revolution n:
//   beyond_n  = max(0, beyond change - max(share, uneven feed) * load)
//   chatter_n = min(beyond_n, 2 beyond_(n-1))
// "Beyond change" is what differs from revolution to revolution and from tooth to tooth of that and
// is no even change (revolution_comb.hpp). Load is the mean square of a revolution, the largest one
// remembered with 2 % less for each since; a share of 0.001 leaves the cut irregularities of 4.5 %
// of its torque; where the feed has differed by a part within five revolutions (ChatterFeed, as far
// as anybody tells it) so do the chips, and the square of that part of the load is left to them.
// Chatter grows, a jump of the cut does not: a verdict counts for twice the one before at most.
// beyond_n is 0
//   - where the revolution takes another course once and keeps it (a tooth breaks;
//     revolution_comb.hpp, steps, which tooth breakage may tell of, too; not while a threshold is
//     learned);
//   - while the load rises to more than three times within three revolutions (the first teeth
//     touch);
//   - after both, and after a jolt of the spindle, as long as the change falls: what it rings, in a
//     belt say, dies away, and chatter grows. A jolt is a torque by which the spindle's
//     acceleration changes from revolution to revolution, of as much power as what is heard.
// From the first teeth on until the mean torque falls the cut is being entered
// (revolution_comb.hpp). A quarter of beyond_n counts while the mean torque shows no cut. Teeth
// unknown, a change that lasts for the whole window counts as well, also that of a long entry.
// Besides, a narrow line in what changes from revolution to revolution (chatter_lines.hpp), which
// noise hides from a power: its score is judged by its own threshold with every transform, without
// a warning, under the same conditions, while the feed is even within 7 %, and in a window that
// begins after the entry; its load share is that of one line.
// Discretisation: every sample is added to the sums of the present revolution, and the window
// moves on by one revolution when that is complete. So nothing is ever subtracted, and no rounding
// error lives longer than the window. A revolution begins where the angle of the first sample
// comes round again, between two samples: the window is a whole number of revolutions at every
// speed and follows the speed by itself. Torque is counted from the mean of the revolution before.
// Harmonics at or above half the sample rate are left out.
// Delay: of total and forced half the window, renewed once a revolution, and H + 5 samples; of
// chatter one revolution. An alarm comes consecutive_revolutions + 1 revolutions after the
// threshold is lastingly exceeded, that for forced vibration up to R later. After a restart R + 1
// revolutions pass, one to learn the mean.
// Cost on Cortex-M4F: 275 + 13 H instructions (402 for ten harmonics and 62 samples a revolution;
// 55 are the comb's), 313 more with lines; 831 for the worst sample with R = 8, with lines 1589;
// 25 more for each revolution more.
// Range: |torque| < 1e15 Nm; from minimum_speed_rad_s up to an eighth of a turn a sample; chatter
// from three samples a tooth on.
// Numerical bound: after 24 h as after one window. Leak of forced power into the residue: below
// 1e-6 of it when a revolution is a whole number of samples, else below (h step)^2 / (5 W), step
// the angle turned in a sample: 1.5e-4 for the sixth harmonic at 7700 rpm and 8 kHz.
// Bad at: chatter near a harmonic of both rotation and tooth passing frequency (with an even number
// of teeth also that of period two); above about 2 kHz at 8 kHz; chatter that grows to one feed per
// tooth within a few revolutions is found after that; a feed that is never even, as on some
// freeform paths: much is left to its chips, and no line is heard; without the axes,
// a feed that comes to rest in the cut, where teeth cut by turns; chatter that begins within two
// revolutions of a step is found after them, of a step that was told of within five.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/core/whole.hpp"
#include "servosense/monitors/chatter_config.hpp"
#include "servosense/monitors/chatter_feed.hpp"
#include "servosense/monitors/chatter_lines.hpp"
#include "servosense/monitors/chatter_verdict.hpp"
#include "servosense/monitors/evidence_ring.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/revolution_comb.hpp"
#include "servosense/monitors/revolution_power.hpp"

namespace servosense {

/// Everything besides the samples that an alarm is replayed from.
template <RealNumber Real>
struct ChatterEvidence {
  std::uint64_t sample = 0;  ///< number of the sample that raised the alarm
  std::uint32_t count = 0;   ///< samples to replay; the last one raised the alarm
  Real shift_Nm = 0;         ///< torque from which the first revolution counts
  AlarmLogic<Real> chatter;  ///< as they were before the alarm
  AlarmLogic<Real> forced;
  std::uint32_t parts = 0;  ///< of a revolution, in the comb
  bool entry = false;       ///< the cut was being entered
  Real load_Nm2 = 0;        ///< as remembered
  Real beyond_Nm2 = 0;      ///< of the revolution before
  Real uneven_feed = 0;     ///< at the alarm
  Real total_Nm2 = 0;
  Real forced_Nm2 = 0;
  Real chatter_Nm2 = 0;
};

/// Revolutions: largest R. Harmonics: largest H. KeptSamples: samples that are kept as evidence;
/// an alarm whose window is longer is raised without.
template <RealNumber Real, std::size_t Revolutions, std::size_t Harmonics, std::size_t KeptSamples,
          ChatterNoise Noise = ChatterNoise::drive>
class ChatterMonitor {
  static_assert(Revolutions >= 3 && Harmonics >= 1 && KeptSamples >= 1);

 public:
  using Config = ChatterConfig;
  using Window = RevolutionPower<Real, Revolutions, Harmonics>;
  using Sample = RevolutionSample<Real>;
  using Evidence = ChatterEvidence<Real>;
  /// Samples after an alarm within which its evidence must be copied.
  static constexpr std::size_t kReadoutSamples = EvidenceRing<Sample, KeptSamples>::kReadout;
  static constexpr std::size_t kParts = 128;  ///< most parts of a revolution in the comb
  using Comb = RevolutionComb<Real, kParts>;
  using Revolution = typename Window::Revolution;
  using Lines = ChatterLines<Real, Noise>;

  struct State {
    MonitorState state =
        MonitorState::idle;  ///< chatter's; forced vibration beyond its threshold: `warning`
    SignalState signal = SignalState::filling;
    Real total_Nm2 = 0;
    Real forced_Nm2 = 0;
    Real residue_Nm2 = 0;          ///< max(0, total - forced)
    Real chatter_Nm2 = 0;          ///< what is judged
    Real line = 0;                 ///< score of the strongest line: its power over that of noise
    std::uint64_t transforms = 0;  ///< of lines, when last judged
    Real beyond_Nm2 = 0;           ///< of the newest revolution: beyond change, load and feed
    Real load_Nm2 = 0;             ///< largest mean square of a revolution, remembered
    ChatterFeed<Real> feed;
    std::uint64_t sample = 0;     ///< number of the newest sample, whether used or not
    std::uint64_t stand_ins = 0;  ///< invalid samples replaced by their predecessor
    std::uint64_t verdicts = 0;   ///< one a revolution, once the window is full
    std::uint64_t restarts = 0;   ///< times the window was emptied
    std::uint64_t stepped = 0;    ///< the last verdict that was none because the torque stepped
    std::uint64_t clamps = 0;     ///< times total - forced came out negative and was given as 0
    std::uint64_t alarms = 0;     ///< times `state` became `alarm`
    Real origin_rad = 0;          ///< spindle angle at which revolutions begin
    std::uint32_t stage = 0;      ///< of the evaluation; 0 = none under way
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (c.window_revolutions < 3 || c.window_revolutions > Revolutions)
      return Status::invalid("window_revolutions", "must be within 3 and the block's capacity");
    if (c.harmonics < 1 || c.harmonics > Harmonics)
      return Status::invalid("harmonics", "must be within 1 and the block's capacity");
    const double step = c.minimum_speed_rad_s * c.sample_period_s;
    if (!(step > 1e-6 && step < kTwoPi / 8))
      return Status::invalid("minimum_speed_rad_s",
                             "must turn the spindle by 1e-6 rad to an eighth turn a sample");
    if (!(c.tolerated_stand_ins >= 0 && c.tolerated_stand_ins <= 1))
      return Status::invalid("tolerated_stand_ins", "must be within 0 and 1");
    if (c.teeth > kParts) return Status::invalid("teeth", "must be at most 128");
    if (!(c.tolerated_load_share >= 0 && c.tolerated_load_share < 1))
      return Status::invalid("tolerated_load_share", "must be within 0 and 1");
    if (!(c.cutting_torque_Nm >= 0 && is_finite(c.cutting_torque_Nm)))
      return Status::invalid("cutting_torque_Nm", "must be zero (not known) or positive");
    if (c.consecutive_revolutions < 1)
      return Status::invalid("consecutive_revolutions", "must be at least 1");
    const Status chatter = AlarmLogic<Real>::validate(logic(c, c.chatter_threshold_Nm2));
    if (!chatter.ok()) return renamed(chatter, "chatter_threshold_Nm2");
    return renamed(AlarmLogic<Real>::validate(logic(c, c.forced_threshold_Nm2)),
                   "forced_threshold_Nm2");
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    window_.configure(c.window_revolutions, c.harmonics, c.sample_period_s);
    slowest_ = whole(kTwoPi / (c.minimum_speed_rad_s * c.sample_period_s));
    tolerated_ = static_cast<Real>(c.tolerated_stand_ins);
    // Of a sensor every cut is uneven: chatter is more of it than all that turns.
    rule_.share = Lines::kOfSensor ? Real(0.5) : static_cast<Real>(c.tolerated_load_share);
    rule_.cutting_Nm = static_cast<Real>(c.cutting_torque_Nm);
    comb_.configure(c.teeth, static_cast<Real>(c.chatter_threshold_Nm2));
    inertia_ = static_cast<Real>(c.lines.inertia_kg_m2 / (c.sample_period_s * c.sample_period_s));
    lines_.configure(c);
    learns_ = !(c.chatter_threshold_Nm2 > 0) && !(Lines::kOfSensor && lines_.on());
    chatter_.configure(logic(c, c.chatter_threshold_Nm2));
    AlarmLogicConfig line = logic(c, lines_.on() && !learns_ ? c.lines.threshold : 0);
    line.warning_fraction = 1;
    line.consecutive_samples = Lines::kConsecutive;
    line_.configure(line);
    forced_.configure(logic(c, c.forced_threshold_Nm2));
    reset();
  }
  void reset() noexcept {
    chatter_.reset();
    line_.reset();
    forced_.reset();
    stop_comb();
    lines_.reset();
    window_.reset();
    state_ = State{};
    evidence_ = Evidence{};
  }

  /// Whether tell_position() is due: once a revolution, after process().
  [[nodiscard]] bool asks_position() const noexcept { return state_.stage == 1; }
  /// Where the axes are [m], from any origin that stays; an axis nobody knows stays at 0. Never
  /// told, the feed counts as even.
  void tell_position(const std::array<Real, 3>& position_m) noexcept {
    state_.feed.take(position_m, window_.before(1).samples);
  }

  /// One servo period: cutting torque, spindle angle within the turn [0, 2 pi), its increment
  /// since the last sample, and what is known against them.
  MonitorState process(Real torque_Nm, Real turn_angle_rad, Real increment_rad,
                       Quality quality) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    ++s.sample;
    if (has(quality, kBreaks)) {
      empty_window();
      // Behind a gap, and while a block in front of this one settles, there is nothing to keep.
      if (has(quality, Quality::gap)) return judge(SignalState::faulty);
      if (has(quality, Quality::settling)) return judge(SignalState::filling);
    }
    const bool turn_fits =
        turn_angle_rad >= 0 && turn_angle_rad <= kTurn && magnitude(increment_rad) <= kTurn / 8;
    const bool faulty = has(quality, kUnusable) || !turn_fits || !fits_window(torque_Nm);
    if (faulty) {
      ++s.stand_ins;
      if (window_.empty()) return judge(SignalState::faulty);
      const Sample& last = window_.state().last;
      ++window_.present().stand_ins;
      torque_Nm = last.torque_Nm;
      if (!turn_fits) {  // the spindle turns on meanwhile
        increment_rad = last.increment_rad;
        turn_angle_rad = s.origin_rad + last.angle_rad + increment_rad;
      }
    }
    if (window_.empty()) {
      s.origin_rad = turn_angle_rad;
      begin({torque_Nm, 0, increment_rad});
      return s.signal == SignalState::standstill ? s.state : judge(SignalState::filling);
    }
    Real angle = turn_angle_rad - s.origin_rad;
    if (angle < 0) angle += kTurn;
    if (angle >= kTurn) angle -= kTurn;
    advance({torque_Nm, angle, increment_rad});
    // A few stand-ins are no reason to fall silent: the verdict counts them.
    const auto left_out = static_cast<Real>(window_.present().stand_ins);
    if (faulty && left_out > tolerated_ * window_.state().samples)
      return judge(SignalState::faulty);
    return s.state;
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  [[nodiscard]] const typename Window::State& window() const noexcept { return window_.state(); }
  [[nodiscard]] const Comb& comb() const noexcept { return comb_; }
  [[nodiscard]] const Lines& lines() const noexcept { return lines_; }
  /// Of the newest revolution, from its verdict until the next one is complete; a change that lasts
  /// is left out.
  [[nodiscard]] ChatterMeasures<Real> measures() const noexcept {
    ChatterMeasures<Real> m;
    m.beyond_change = comb_.rings() && !learns_ ? Real(0) : comb_.beyond_change();
    const Real newest = window_.before(1).load;
    m.remembered = newest > state_.load_Nm2 ? newest : state_.load_Nm2;
    m.load = {window_.before(1).load, window_.before(2).load, window_.before(3).load};
    m.mean_Nm = window_.present().shift;  // the present one counts from it
    m.uneven_feed = state_.feed.uneven;
    return m;
  }
  /// Tooth breakage has raised an alarm: the step that it heard is not judged. What is compared
  /// begins with the next revolution, so chatter that goes on is told of five revolutions later at
  /// most. While a threshold is learned steps count, told or not.
  void tell_step() noexcept {
    if (learns_) return;
    comb_.tell_step();
    lines_.restart();
    state_.stepped = state_.verdicts;
  }
  /// Lines of the machine itself [Hz], which are not judged; the first kOwnLines count.
  void set_own_lines(std::span<const double> own_hz) noexcept requires(Lines::kOfSensor) {
    lines_.set_own_lines(own_hz);
  }
  /// Another monitor of the same spindle has been told where the axes are.
  void follow_feed(const ChatterFeed<Real>& feed) noexcept requires(Lines::kOfSensor) {
    state_.feed = feed;
  }
  /// Of a sensor, which has no mean: that nothing is cut is known from elsewhere.
  void tell_air(bool air) noexcept requires(Lines::kOfSensor) {
    rule_.cutting_Nm = air ? std::numeric_limits<Real>::max() : Real(0);
  }
  /// The torque has stepped, or was said to, within the last three verdicts, and no alarm stands: a
  /// broken tooth steps in two revolutions and is told of in the third at the latest.
  [[nodiscard]] bool stepped() const noexcept {
    return state_.stepped > 0 && state_.verdicts - state_.stepped < 3 &&
           state_.state != MonitorState::alarm;
  }
  [[nodiscard]] const AlarmLogic<Real>& alarm(ChatterSign sign) const noexcept {
    return sign == ChatterSign::power ? chatter_ : sign == ChatterSign::line ? line_ : forced_;
  }
  [[nodiscard]] Real value(ChatterSign sign) const noexcept {
    return sign == ChatterSign::power  ? state_.chatter_Nm2
           : sign == ChatterSign::line ? state_.line
                                       : state_.forced_Nm2;
  }
  /// What the present state is of; of several the power.
  [[nodiscard]] ChatterSign sign() const noexcept {
    if (chatter_.state().state == state_.state) return ChatterSign::power;
    return state_.state == MonitorState::alarm ? ChatterSign::line : ChatterSign::forced;
  }

  /// What the last alarm was raised from; count = 0 before the first, or when the window was
  /// longer than KeptSamples.
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
    if (samples.size() < 2) return state_.state;
    window_.set_last(samples[0]);
    window_.open(samples[1], window_.boundary_before(samples[1]), e.shift_Nm);
    comb_.start(e.parts);
    comb_.tell_entry(e.entry);
    comb_.end_turn();
    begin_comb(window_.present());
    state_.load_Nm2 = e.load_Nm2;
    state_.beyond_Nm2 = e.beyond_Nm2;
    state_.feed.uneven = e.uneven_feed;
    chatter_ = e.chatter;
    forced_ = e.forced;
    replaying_ = true;  // the comb keeps its parts
    for (const Sample& sample : samples.subspan(2)) advance(sample);
    replaying_ = false;
    return state_.state;
  }

 private:
  static constexpr Real kTurn = static_cast<Real>(kTwoPi);
  static constexpr std::uint32_t kSums = 2;  // stage of the evaluation
  static constexpr Quality kBreaks = Quality::restarted | Quality::gap | Quality::settling;

  static AlarmLogicConfig logic(const Config& c, double threshold) noexcept {
    // A gap is heard of sample by sample: an alarm outlasts a second of it.
    return {threshold,
            c.warning_fraction,
            c.release_fraction,
            c.release_revolutions,
            c.consecutive_revolutions,
            nearest_whole(1 / c.sample_period_s)};
  }
  // Both alarms call their threshold "threshold".
  static Status renamed(const Status& s, const char* threshold) noexcept {
    return !s.ok() && s.parameter()[0] == 't' ? Status::invalid(threshold, s.reason()) : s;
  }
  // From where revolutions begin, in the direction of the rotation.
  static Real along(const Sample& in) noexcept {
    return in.increment_rad < 0 ? kTurn - in.angle_rad : in.angle_rad;
  }
  static Real magnitude(Real x) noexcept { return std::abs(x); }

  // Forgets the samples, keeps the alarm logic, the counters and the last results.
  void empty_window() noexcept {
    if (window_.empty()) return;
    ++state_.restarts;
    window_.empty_out();
    state_.stage = 0;
    stop_comb();
  }

  void begin(const Sample& in) noexcept {
    window_.begin(in);
    kept_.push(in);
  }

  void advance(const Sample& in) noexcept {
    State& s = state_;
    lines_.step(s.load_Nm2);
    const Sample& last = window_.state().last;
    if (magnitude(in.angle_rad - last.angle_rad) > kTurn / 2) return pass_boundary(in);
    const Revolution& r = window_.present();
    const Real here = along(in);
    const bool ends = here >= comb_.edge_rad();
    if (ends) {
      const Real before = along(last);
      end_part(r, last.torque_Nm, in.torque_Nm, (comb_.edge_rad() - before) / (here - before), 1);
    }
    window_.add(in);
    kept_.push(in);
    if (r.samples > slowest_) {
      empty_window();
      judge(SignalState::standstill);
    } else if (s.stage > 0 && !(ends && s.stage == kSums)) {
      evaluate();  // the sums, the dearest stage, wait a sample for the end of a part
    }
  }

  void pass_boundary(const Sample& in) noexcept {
    State& s = state_;
    while (s.stage > 0) evaluate();  // only when the angle jumps: see there
    const Real turned = magnitude(window_.present().turned_rad);
    if (!(turned > kTurn / 2 && turned < kTurn * Real(1.5))) {
      // No revolution: the spindle swung to and fro over the boundary, or the angle jumped.
      empty_window();
      begin(in);
      if (s.signal != SignalState::standstill) judge(SignalState::filling);
      return;
    }
    window_.pass_boundary(in);
    kept_.push(in);
    s.stage = 1;
    if (s.signal == SignalState::standstill) judge(SignalState::filling);
  }

  // A part of the comb ends between two samples, `f` after the first. The integral is that of
  // straight lines from sample to sample, up to half the first one of the revolution.
  // That sample was so many samples `ago`.
  void end_part(const Revolution& r, Real last_Nm, Real next_Nm, Real f, int ago) noexcept {
    const Real half = Real(0.5) * (last_Nm - r.shift);
    comb_.end_part(r.shift, r.sum - half + f * (half + half + Real(0.5) * f * (next_Nm - last_Nm)),
                   static_cast<Real>(r.samples) + f);
    if (lines_.on() && comb_.compares() && !replaying_)
      lines_.take(comb_.last_change(), static_cast<Real>(ago) - f);
  }
  void stop_comb() noexcept {
    comb_.stop();
    lines_.restart();
  }
  void start_comb(std::uint32_t parts) noexcept {
    comb_.start(parts);
    lines_.start(parts);
  }
  // The revolution before the present one: its load, its end for the comb.
  void close_turn() noexcept {
    State& s = state_;
    const Revolution& r = window_.present();
    Revolution& past = window_.before(1);
    past.load =
        (past.square + past.shift * (past.sum + past.sum)) / static_cast<Real>(past.samples) +
        past.shift * past.shift;
    // What stands in for lost samples is no load to remember.
    if (!replaying_)
      s.load_Nm2 =
          ChatterRule<Real>::remember(past.stand_ins > 0 ? Real(0) : past.load, s.load_Nm2);
    const Real f = r.begins_after;
    if (comb_.running()) {
      end_part(past, r.before.torque_Nm, r.first.torque_Nm, f, 2);
      comb_.end_turn();
      follow_jolts();
    }
    past.change = comb_.settled() ? comb_.state().change_Nm2 : Real(0);
    if (!replaying_ && comb_.unfit(past.samples)) start_comb(comb_.parts_for(past.samples));
    if (comb_.running()) begin_comb(r);
  }
  // What makes the machine ring or the course of the torque change without chatter: the first teeth
  // touch, and the cut is entered from then on while the mean torque rises; or the spindle begins
  // or ends to accelerate, by a torque whose ring in a belt or shaft has as much power as what is
  // heard.
  void follow_jolts() noexcept {
    if constexpr (Lines::kOfSensor) return;
    if (!comb_.valid() || learns_) return;
    const auto before = [&](std::uint32_t n) -> const Revolution& { return window_.before(n); };
    const bool touches =
        ChatterRule<Real>::touches({before(1).load, before(2).load, before(3).load});
    // A revolution counts from the mean of that before.
    const Real mean = magnitude(window_.present().shift), last = magnitude(before(1).shift);
    comb_.tell_entry(touches || (comb_.state().entry && mean > last));
    const auto pace = [&](std::uint32_t n) {
      return before(n).turned_rad / static_cast<Real>(before(n).samples);
    };
    const auto samples = static_cast<Real>(before(1).samples);
    const Real jolt_Nm = inertia_ * (pace(1) - pace(2) - (pace(2) - pace(3))) / samples;
    if (touches || Real(0.5) * jolt_Nm * jolt_Nm > comb_.beyond_change()) comb_.shake();
  }
  void begin_comb(const Revolution& r) noexcept {
    const Real ahead = Real(1) - r.begins_after;
    const Real first = r.first.torque_Nm - r.shift;
    const Real rise = r.first.torque_Nm - r.before.torque_Nm;
    comb_.begin_turn(Real(0.5) * first - ahead * (first - Real(0.5) * ahead * rise),
                     r.begins_after);
  }

  // One stage a sample, so that no sample costs much more than another: the comb, sums,
  // length and total power of the window, its harmonics one by one, the verdict. Only harmonics
  // below half the sample rate are read, so at eight samples or more a revolution the last stage
  // comes before it ends.
  void evaluate() noexcept {
    State& s = state_;
    const std::uint32_t stage = s.stage++;
    if (stage == 1) {
      close_turn();
      if (!window_.full()) s.stage = 0;
    } else if (stage == kSums) {
      window_.evaluate_sums();
    } else if (stage == 3) {
      window_.evaluate_total();
    } else if (stage - 4 < window_.state().harmonics) {
      window_.evaluate_line(stage - 4);
    } else {
      s.stage = 0;
      evaluate_verdict();
    }
  }

  // Teeth unknown, the comb hears half of all frequencies. A change that lasts for the whole window
  // is the other sign of chatter there.
  [[nodiscard]] Real lasting_change() const noexcept {
    Real least = state_.load_Nm2;
    std::uint32_t i = 0;
    window_.for_window([&](const Revolution& r) {
      if (i++ > 0 && r.change < least) least = r.change;  // a replay lacks that of the oldest
    });
    return least;
  }

  [[nodiscard]] Real beyond_change() const noexcept {
    // A sensor hears axes that accelerate.
    if (Lines::kOfSensor && !state_.feed.steady()) return Real(0);
    ChatterMeasures<Real> m = measures();
    if (!comb_.knows_teeth()) {
      const Real lasting = lasting_change();
      if (lasting > m.beyond_change) m.beyond_change = lasting;
    }
    return rule_.beyond(m);
  }

  // A line counts in a cut that is fed evenly and neither begins nor steps. While it is entered
  // every revolution shakes the machine more than the last, and what rings from that stands in the
  // window as a line that lasts. A sensor's load has no mean, so noise and chatter make it rise as
  // an entry does; that would have to hold on there.
  [[nodiscard]] bool hears_lines() const noexcept {
    const ChatterMeasures<Real> m = measures();
    if constexpr (Lines::kOfSensor) return state_.feed.steady() && rule_.cuts(m.mean_Nm);
    return state_.feed.steady() && !comb_.rings() && !comb_.state().entry &&
           rule_.cuts(m.mean_Nm) && !ChatterRule<Real>::touches(m.load);
  }
  // With every transform that is new; elsewhere there is none, with every revolution.
  void judge_line() noexcept {
    State& s = state_;
    const std::uint64_t transforms = lines_.state().transforms;
    const bool hears = hears_lines();
    if (!hears) lines_.restart();
    s.line = lines_.state().found.score;
    if (!hears || transforms != s.transforms) line_.process(s.line, SignalState::good);
    s.transforms = transforms;
  }

  void evaluate_verdict() noexcept {
    State& s = state_;
    const typename Window::State& w = window_.state();
    s.total_Nm2 = w.evaluation.total_Nm2;
    s.forced_Nm2 = w.evaluation.forced_Nm2;
    ++s.verdicts;
    const Real difference = s.total_Nm2 - s.forced_Nm2;
    if (difference < 0) ++s.clamps;
    s.residue_Nm2 = difference > 0 ? difference : Real(0);
    const Real before = s.beyond_Nm2;
    // A stand-in differs from the turn before as chatter does.
    const bool whole =
        window_.before(1).stand_ins + window_.before(2).stand_ins + window_.before(3).stand_ins ==
        0;
    if (whole) {
      s.beyond_Nm2 = beyond_change();
      if (comb_.steps()) s.stepped = s.verdicts;
      s.chatter_Nm2 = ChatterRule<Real>::judged(s.beyond_Nm2, before);
    }
    const bool good = static_cast<Real>(w.evaluation.stand_ins) <= tolerated_ * w.samples;
    const AlarmLogic<Real> chatter = chatter_;
    const AlarmLogic<Real> forced = forced_;
    const MonitorState was = s.state;
    if (good && whole && line_.threshold() > 0) judge_line();
    judge(!good ? SignalState::filling : whole ? SignalState::good : SignalState::doubtful);
    if (s.state == MonitorState::alarm && was != MonitorState::alarm)
      keep_evidence(chatter, forced, before);
  }

  MonitorState judge(SignalState signal) noexcept {
    State& s = state_;
    s.signal = signal;
    MonitorState a = chatter_.process(s.chatter_Nm2, signal);
    if (signal != SignalState::good) line_.process(s.line, signal);
    // Of a sensor lines alone may be judged.
    if constexpr (Lines::kOfSensor)
      if (!(chatter_.threshold() > 0)) a = line_.state().state;
    if (line_.state().state == MonitorState::alarm) a = MonitorState::alarm;
    MonitorState b = forced_.process(s.forced_Nm2, signal);
    if (b == MonitorState::alarm) b = MonitorState::warning;  // it must not hide chatter
    return s.state = a > b ? a : b;
  }

  void keep_evidence(const AlarmLogic<Real>& chatter, const AlarmLogic<Real>& forced,
                     Real beyond_before_Nm2) noexcept {
    State& s = state_;
    ++s.alarms;
    Evidence& e = evidence_;
    e.sample = s.sample;
    e.count = window_.present().samples;
    window_.for_window([&](const Revolution& r) { e.count += r.samples; });
    ++e.count;  // the window begins between the sample before its first one and that
    // A line is heard over more than the window.
    if (e.count > KeptSamples || chatter_.state().state != MonitorState::alarm) e.count = 0;
    e.shift_Nm = window_.oldest().shift;
    e.chatter = chatter;
    e.forced = forced;
    e.parts = comb_.state().parts;
    e.entry = comb_.state().entry;
    e.load_Nm2 = s.load_Nm2;
    e.beyond_Nm2 = beyond_before_Nm2;
    e.uneven_feed = s.feed.uneven;
    e.total_Nm2 = s.total_Nm2;
    e.forced_Nm2 = s.forced_Nm2;
    e.chatter_Nm2 = s.chatter_Nm2;
    kept_.mark();
  }

  State state_;
  Window window_;
  Comb comb_;
  AlarmLogic<Real> chatter_;
  AlarmLogic<Real> line_;  // without a threshold where no lines are heard
  AlarmLogic<Real> forced_;
  Evidence evidence_;
  EvidenceRing<Sample, KeptSamples> kept_;
  std::uint32_t slowest_ = 0;  // samples a revolution at the minimum speed
  Real tolerated_ = 0;
  Real inertia_ = 0;    // [Nm] for a radian a sample, squared; 0: not known
  bool learns_ = true;  // without a threshold steps count: what idles has no tooth that breaks
  ChatterRule<Real> rule_;
  bool replaying_ = false;
  Lines lines_;
};

}  // namespace servosense
