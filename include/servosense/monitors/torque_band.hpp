// Torque band monitor: measured cutting torque against what was predicted or taught, with tolerance
// in magnitude and in time.
//
// Purpose: finds whatever moves the torque off its reference: a wrong or missing tool, a wrong or
// misplaced workpiece, excess wear, a failed drive (Bertok 1984, sections 4.6.3 and 5.4). The
// reference (monitors/torque_band_points.hpp) stays in the caller's memory: points at equal
// distances of program time [s] or path [m], all lengths below in that unit.
// Equation: alarm when no admissible alignment explains the torque. For shifts d on a grid within
// +-max_shift, after every step of the program with its mean m over whole revolutions (4.5.1):
//   J(d) <- (1 - 1/memory_steps) J(d) + z,  z = min(1, excess of m over [lower, upper](x + d) / h)
// h an eighth of the band's width. Whenever the program has moved by shift_step / max_drift each d
// may take over a neighbour's J if that is smaller. Then J(d) is the least that any course of the
// shift that ends at d, within +-max_shift and no faster than max_drift, has left outside the band.
// value = min J(d), alarm at alarm_steps. So the band is aligned by itself, a timing error within
// these bounds never alarms, and no torque is explained by an alignment that contradicts the
// memory. The source aligned by hand. `shift`, for the reader: of the d about as good as the best,
// the one with the least squared error against the reference. Feed override o: torque grows with
// feed, less than proportionally (4.1), so lower - (1 - o) torque for o < 1 and o upper for o > 1
// are on the safe side.
// Sections: where the reference has them, the program is where its section begins with every block
// that the controller reports (the signal that the source proposed), and with every spindle that
// has come to a steady speed: the nearest section of that block and speed within max_shift. From
// there on only shifts within sync_shift are admissible, and what was left outside until then
// stays. Program time is then that of steady turning; while the spindle stands or changes its speed
// nothing is expected (monitors/turn_steps.hpp). A block that the reference does not know is not
// judged. Air: where all admissible shifts expect the section's air level, the level follows, by
// air_limit_Nm at most.
// Cause of an alarm, as far as torque tells it, where the controller says the program is: another
// number of teeth pulses (monitors/tooth_count.hpp), which alarms by itself; nothing is cut where
// the band excludes the air; something is where nothing is expected; else what the cuts so far, by
// the reference's sections, leave open (monitors/torque_cause.hpp).
// Discretisation: revolutions end between samples. A step is judged once the next is steady too.
// Delay: one and a half steps, two samples for each shift, and the steps that collect alarm_steps
// (three when the torque is out by h and more).
// Cost on Cortex-M4F: bench/firmware/instructions.csv, torque_band, with 41 shifts and a step of
// 20 ms.
// Range: |torque| < 1e15 Nm; a step must last 2 shifts / shifts_per_sample samples, else it grows.
// Numerical bound: J <= 2 alarm_steps + 1, a contraction; position exact to half a rounding a
// step within its point of the reference.
// Bad at: a fault that looks like a shift (extra stock before the cut and as much missing behind
// it); deviations within the band; tolerances in time finer than shift_step and step.
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
#include "servosense/monitors/evidence.hpp"
#include "servosense/monitors/monitor.hpp"
#include "servosense/monitors/program_place.hpp"
#include "servosense/monitors/tooth_count.hpp"
#include "servosense/monitors/torque_band_points.hpp"
#include "servosense/monitors/torque_cause.hpp"
#include "servosense/monitors/turn_steps.hpp"

namespace servosense {

struct TorqueBandConfig {
  double spacing = 0;         ///< of the reference's points, program time [s] or path [m]
  double step = 0;            ///< of the program between verdicts, at least
  double max_shift = 0;       ///< that the reference may be early or late
  double shift_step = 0;      ///< grid of shifts; half the band's tolerance in time or finer
  double sync_shift = 0.2;    ///< the same where a section has just begun; below max_shift
  double max_drift = 0.02;    ///< of the shift, part of the progress; the source saw 0.012
  double memory_steps = 200;  ///< that a contradiction is remembered for
  double alarm_steps = 3;     ///< outside the band that raise an alarm; 0 = off
  double warning_fraction = 0.5;
  double release_fraction = 0.4;
  unsigned release_steps = 8;
  double air_limit_Nm = 0;  ///< largest deviation of the air level that is subtracted; 0 = none
  double tolerated_stand_ins = 0.25;
  double steady_share = 0.02;      ///< by which the spindle's speed may change in a step
  double sample_period_s = 0;      ///< tells the spindle's speed; 0 = speeds are not compared
  bool over_path = false;          ///< lengths are of path: the program may move in jerks
  bool has_cuts = false;           ///< the reference says what else the program asks for
  unsigned shifts_per_sample = 1;  ///< that are worked on; more where samples are few
  ToothCountConfig tooth_count{};  ///< where the reference has lines
};

/// Shifts: most points of the shift grid, odd.
template <RealNumber Real, std::size_t Shifts = 65>
class TorqueBandMonitor {
  static_assert(Shifts % 2 == 1);

 public:
  using Config = TorqueBandConfig;
  using Point = TorqueBandPoint<Real>;
  using Section = TorqueBandSection<Real>;
  static constexpr std::size_t kEvidenceStride = 16;

  /// What is known of the shift.
  enum class Join : std::uint8_t { goes_on, at_section, anywhere };
  /// One step of the program.
  struct Input {
    Real mean_Nm = 0;
    std::uint32_t cell = 0;  ///< middle of the step: point of the reference...
    Real within = 0;         ///< ...and beyond it
    Real progress = 0;
    Real feed_override = 1;
    Real feed = 0;    ///< progress per second; 0 = unknown
    Real air_Nm = 0;  ///< level of the section
    bool has_air = false;
    Join join = Join::goes_on;
    std::uint8_t teeth = 0;  ///< that cut, where they are others than the program's
  };
  /// Everything that passes from step to step.
  struct Core {
    std::array<Real, Shifts> outside{};  ///< J
    std::array<Real, Shifts> error{};    ///< squared error against the reference
    Real slack = 0;                      ///< that the shift may have moved since it last could
    Real air_Nm = 0;
    AlarmLogic<Real> alarm;
    // Of the step under evaluation.
    Input in;
    bool moves = false;
    bool all_air = true;
    Real last_outside = 0;  // of the shift before, as it was
    Real last_error = 0;
    Real carried = 0;  // over to a section that begins
    Real least = 0;
    std::uint32_t best = 0;
    Real best_error = 0;
    ComparedCut<Real> here;           // of this section
    TorqueExplanations<Real> before;  // of those before
    bool has_cut = false;
    TorqueCause suspected;  // of the last step outside
    TorqueCause cause;      ///< of the last alarm
    // Of the last verdict.
    Real value = 0;
    Real shift = 0;
    Real measured_Nm = 0;
    Real expected_Nm = 0;
    Real lower_Nm = 0;
    Real upper_Nm = 0;
  };
  struct State {
    MonitorState state = MonitorState::idle;
    bool started = false;
    bool judged = false;  ///< since the last fault
    std::uint64_t sample = 0;
    std::uint64_t steps = 0;  ///< judged
    std::uint64_t alarms = 0;
    std::uint64_t stand_ins = 0;  ///< samples not used
    std::uint64_t restarts = 0;   ///< times every shift became possible again
    std::uint64_t sections = 0;   ///< times the program was found at the beginning of one
  };
  using Recorder = EvidenceRecorder<Core, Input, kEvidenceStride>;
  using Evidence = typename Recorder::Evidence;

  static Status validate(const Config& c) noexcept {
    if (!(c.spacing > 0 && is_finite(c.spacing)))
      return Status::invalid("spacing", "must be positive");
    if (!(c.step > 0 && c.step < 1e6 * c.spacing))
      return Status::invalid("step", "must be positive, below a million times spacing");
    if (!(c.max_shift >= 0 && c.max_shift < 1e6 * c.spacing))
      return Status::invalid("max_shift", "must be at least 0, below a million times spacing");
    if (!(c.shift_step > 0 && is_finite(c.shift_step)))
      return Status::invalid("shift_step", "must be positive");
    if (!(2 * std::floor(c.max_shift / c.shift_step + 1e-9) + 1 <= static_cast<double>(Shifts)))
      return Status::invalid("shift_step", "leaves more shifts than the block has room for");
    if (!(c.sync_shift >= 0)) return Status::invalid("sync_shift", "must be at least 0");
    if (!(c.max_drift >= 0 && c.max_drift < 1))
      return Status::invalid("max_drift", "must be at least 0 and below 1");
    if (!(c.memory_steps >= 1 && c.memory_steps <= 1e6))
      return Status::invalid("memory_steps", "must be within 1 and 1e6");
    if (!(c.air_limit_Nm >= 0 && is_finite(c.air_limit_Nm)))
      return Status::invalid("air_limit_Nm", "must be zero (none) or positive");
    if (!(c.tolerated_stand_ins >= 0 && c.tolerated_stand_ins < 1))
      return Status::invalid("tolerated_stand_ins", "must be at least 0 and below 1");
    if (!(c.steady_share > 0 && c.steady_share < 1))
      return Status::invalid("steady_share", "must be within 0 and 1");
    if (!(c.sample_period_s >= 0 && is_finite(c.sample_period_s)))
      return Status::invalid("sample_period_s", "must be zero (unknown) or positive");
    if (c.shifts_per_sample < 1) return Status::invalid("shifts_per_sample", "must be at least 1");
    if (!(c.alarm_steps >= 0 && c.alarm_steps <= 0.5 * c.memory_steps))
      return Status::invalid("alarm_steps", "must be at least 0, half of memory_steps at most");
    return AlarmLogic<Real>::validate(logic(c));
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    auto real = [](double x) { return static_cast<Real>(x); };
    spacing_ = real(c.spacing);
    per_spacing_ = real(1 / c.spacing);
    shift_step_ = real(c.shift_step);
    reach_ = static_cast<std::uint32_t>(c.max_shift / c.shift_step + 1e-9);
    const double sync = c.sync_shift < c.max_shift ? c.sync_shift : c.max_shift;
    sync_ = static_cast<std::uint32_t>(sync / c.shift_step + 1e-9);
    drift_ = real(c.max_drift);
    keep_ = real(1 - 1 / c.memory_steps);
    most_ = real(2 * c.alarm_steps + 1);
    air_limit_ = real(c.air_limit_Nm);
    place_.configure(c.spacing, c.max_shift);
    rate_ = c.sample_period_s > 0 ? real(1 / c.sample_period_s) : Real(0);
    turn_rate_ = c.sample_period_s > 0 ? real(kTwoPi / c.sample_period_s) : Real(0);
    over_path_ = c.over_path;
    per_sample_ = c.shifts_per_sample;
    teeth_.configure(c.tooth_count);
    TurnStepsConfig steps;
    steps.step = c.step;
    steps.steady_share = c.steady_share;
    if (c.over_path) steps.most_steps = kMostSteps;
    steps.tolerated_stand_ins = c.tolerated_stand_ins;
    steps_.configure(steps);
    core_.alarm.configure(logic(c));
    reset();
  }
  /// Forgets everything but the reference.
  void reset() noexcept {
    const AlarmLogic<Real> alarm = core_.alarm;
    core_ = Core{};
    core_.alarm = alarm;
    core_.alarm.reset();
    core_.slack = Real(0.5) * shift_step_;
    state_ = State{};
    recorder_.reset();
    place_.start(0);
    stage_ = 0;
    restart();
  }
  /// Misuse contract: what it views must outlive its use, two points at least. Stops a program
  /// under way.
  void set_reference(TorqueBandView<Real> reference) noexcept {
    points_ = reference.points;
    cuts_ = reference.cuts;
    changes_ = reference.changes;
    lines_ = reference.lines;
    teeth_.begin(nullptr);
    Real highest = 0;
    for (const Point& p : points_) {
      const Real size = p.torque_Nm < 0 ? -p.torque_Nm : p.torque_Nm;
      if (p.expects() && size > highest) highest = size;
    }
    cut_error_ = kCutError * highest;
    place_.set_reference(reference.sections, points_.size());
    state_.started = false;
    stage_ = 0;
  }
  void set_reference(std::span<const Point> points) noexcept {
    set_reference(TorqueBandView<Real>{points, {}});
  }
  /// The program is at point `cell` of the reference, give or take max_shift: at its start, and
  /// where the controller knows better. Requires a reference.
  void start(std::uint32_t cell = 0) noexcept {
    place_.start(cell);
    fresh_ = true;
    heard_ = false;
    state_.started = points_.size() >= 2;
    stage_ = 0;
    restart();
    core_.value = 0;
    state_.state =
        core_.alarm.process(0, state_.started ? SignalState::filling : SignalState::standstill);
  }

  /// One servo period: cutting torque, spindle increment, how far the program has moved (override
  /// included), feed override (1 when unknown), what is known against any of them, and the
  /// controller's block.
  MonitorState process(Real torque_Nm, Real increment_rad, Real advance, Real feed_override,
                       Quality quality, std::int32_t block = kNoBlock) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    ++s.sample;
    if (stage_ != 0) evaluate();
    if (s.started && place_.hear(block, steady_ ? steps_.under_way() : Real(0))) at_section();
    const bool progress_known = advance >= 0 && advance < Real(1e6) * spacing_;
    const Real check = torque_Nm * torque_Nm * Real(1e-30) + increment_rad * increment_rad +
                       feed_override * feed_override;
    if (has(quality, kBreaks | kUnusable) || !(check < Real(1e4)) || !progress_known)
      return take_fault(quality, progress_known ? advance : Real(0));
    if (!s.started) {
      if (s.state == MonitorState::idle) return s.state;
      return s.state = core_.alarm.process(0, SignalState::standstill);
    }
    // Feed hold: the program stands, nothing is expected.
    if (advance == 0 && !over_path_) {
      teeth_.begin(nullptr);
      return s.state;
    }
    if (!lines_.empty()) teeth_.add(torque_Nm, increment_rad);
    if (steps_.add(torque_Nm, increment_rad, advance, feed_override))
      take_step();
    else if (s.state != MonitorState::idle && steps_.stands())
      s.state = core_.alarm.process(0, SignalState::standstill);
    return s.state;
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  [[nodiscard]] const Core& core() const noexcept { return core_; }
  [[nodiscard]] const AlarmLogic<Real>& alarm() const noexcept { return core_.alarm; }
  /// Point of the reference that the program has reached.
  [[nodiscard]] std::uint32_t cell() const noexcept { return place_.cell(); }
  /// What the program asks for now, aligned as the last verdict was; nullptr where the reference
  /// does not have it, and until the controller has named a block of it.
  [[nodiscard]] const ExpectedCut<Real>* expected_cut() const noexcept {
    if (cuts_.empty() || !state_.started || place_.lost() || !place_.told()) return nullptr;
    const Real here = place_.within() + (steady_ ? steps_.under_way() : Real(0)) + core_.shift;
    const auto cell =
        static_cast<std::int32_t>(place_.cell()) + static_cast<std::int32_t>(here * per_spacing_);
    return cell >= 0 && cell < static_cast<std::int32_t>(cuts_.size())
               ? &cuts_[static_cast<std::size_t>(cell)]
               : nullptr;
  }
  /// Torque of the last step beyond the upper limit [Nm].
  [[nodiscard]] Real excess_Nm() const noexcept {
    return core_.measured_Nm > core_.upper_Nm ? core_.measured_Nm - core_.upper_Nm : Real(0);
  }
  /// What the last alarm was raised from; count = 0 before the first. A copy; off the real-time
  /// path.
  [[nodiscard]] Evidence evidence() const noexcept { return recorder_.evidence(); }
  /// The core after the last step of the evidence, bit for bit. Off the real-time path. Requires
  /// the configuration and the reference of the alarm.
  [[nodiscard]] Core replay(const Evidence& e) const noexcept {
    Core core = e.before;
    for (std::uint32_t i = 0; i < e.count; ++i) {
      begin(core, e.inputs[i]);
      for (std::uint32_t k = 0; k < shifts(); ++k) weigh(core, k);
      for (std::uint32_t k = 0; k < shifts(); ++k) rank(core, k);
      conclude(core);
    }
    return core;
  }

 private:
  static constexpr Quality kBreaks = Quality::restarted | Quality::gap | Quality::settling;
  static constexpr unsigned kBehindGap = 2;  // the first revolution has none to be held against
  /// Of the highest expected torque, to which the mean of a cut is known besides a share of its own
  /// (chosen: a third of the tolerance_Nm that a predicted band has by itself).
  static constexpr Real kCutError = Real(0.01);
  struct Limits {
    Real torque, lower, upper;
    bool expects;
  };

  static AlarmLogicConfig logic(const Config& c) noexcept {
    return {c.alarm_steps, c.warning_fraction, c.release_fraction, c.release_steps, 1};
  }
  [[nodiscard]] std::uint32_t shifts() const noexcept { return 2 * reach_ + 1; }
  [[nodiscard]] Real shift_of(std::uint32_t k) const noexcept {
    return (static_cast<Real>(k) - static_cast<Real>(reach_)) * shift_step_;
  }

  // ---- samples ---------------------------------------------------------------------------------

  [[gnu::noinline]] MonitorState take_fault(Quality quality, Real advance) noexcept {
    State& s = state_;
    ++s.stand_ins;
    s.judged = false;
    if (has(quality, kBreaks)) {
      // Nobody knows how far the program has come meanwhile.
      if (steady_ || pending_ || steps_.under_way() > 0) {
        ++s.restarts;
        const Real under_way = steps_.under_way(), hole = hole_;
        restart();
        hole_ = hole + under_way;
      }
      if (heard_) behind_gap_ = kBehindGap;
      if (s.started) hole_ += advance;
      const bool gap = has(quality, Quality::gap);
      return s.state = core_.alarm.process(0, gap ? SignalState::faulty : SignalState::filling);
    }
    teeth_.begin(nullptr);  // the angle is lost
    steps_.leave_out(advance);
    return s.state = core_.alarm.process(0, SignalState::faulty);
  }

  void at_section() noexcept {
    // Where the program was heard from first is no place that the spindle has told.
    join_ = fresh_ ? Join::anywhere : Join::at_section;
    ++state_.sections;
  }
  void restart() noexcept {
    steps_.reset();
    teeth_.begin(nullptr);
    pending_ = steady_ = false;
    hole_ = 0;
    behind_gap_ = 0;
    join_ = Join::anywhere;
  }
  [[gnu::noinline]] void take_step() noexcept {
    const typename TurnSteps<Real>::Step& step = steps_.step();
    if (step.kind == TurnStepKind::unsteady && heard_) fresh_ = false;
    heard_ = true;
    steady_ = step.kind != TurnStepKind::unsteady;
    go_on(step);
    fresh_ = fresh_ && !steady_;
    if (!lines_.empty()) count_teeth();
    if (place_.lost()) {
      if (!place_.has_sections()) state_.started = false;
      pending_ = false;
      state_.state = core_.alarm.process(0, SignalState::standstill);
      return;
    }
    // The step before is judged, now that the one behind it is steady too.
    const bool steady = step.kind == TurnStepKind::steady;
    if (pending_ && steady && stage_ == 0) {
      recorder_.before(core_, next_);
      begin(core_, next_);
      stage_ = 1;
    } else if (pending_ && join_ == Join::goes_on) {
      join_ = next_.join;  // what has not been judged yet
    }
    pending_ = steady && step.usable;
    if (pending_) {
      next_ = input_of(step);
      join_ = Join::goes_on;
    }
  }
  /// The program goes on by a step. With sections, its time is that of steady turning.
  void go_on(const typename TurnSteps<Real>::Step& step) noexcept {
    if (!place_.has_sections()) {
      place_.move(hole_ + step.progress);
      hole_ = 0;
      return;
    }
    if (step.kind == TurnStepKind::unsteady) {
      if (behind_gap_ > 0) --behind_gap_;
      return;
    }
    if (step.kind == TurnStepKind::resumed) place_.move(step.skipped);
    if (step.kind == TurnStepKind::onset) {
      if (place_.find(turn_rate_ / step.turn_samples, behind_gap_ > 0)) {
        at_section();
      } else {
        place_.move(hole_);
        join_ = Join::anywhere;
        // Time stamps span a gap; how far the axes went in it nobody knows.
        if (over_path_ && behind_gap_ > 0) place_.lose();
      }
    }
    behind_gap_ = 0;
    hole_ = 0;
    place_.move(step.progress);
  }
  /// The teeth of one engagement, from the step on behind the one in which it began.
  [[gnu::noinline]] void count_teeth() noexcept {
    const ExpectedCut<Real>* cut = steady_ ? expected_cut() : nullptr;
    const ToothLines<Real>* lines = nullptr;
    if (cut != nullptr && cut->kind == ExpectedCutKind::steady && cut->engagement < lines_.size())
      lines = &lines_[cut->engagement];
    if (lines == teeth_.lines())
      teeth_.judge();
    else
      teeth_.begin(lines);
  }
  /// Middle of the step, as a point and a rest that is not negative.
  [[nodiscard]] Input input_of(const typename TurnSteps<Real>::Step& step) const noexcept {
    Input in;
    in.mean_Nm = step.mean_Nm;
    in.progress = step.progress;
    in.feed_override = step.feed_override;
    if (step.samples > 0) in.feed = step.progress * rate_ / step.samples;
    in.join = join_;
    if (teeth_.other()) in.teeth = static_cast<std::uint8_t>(teeth_.told());
    in.has_air = !place_.has_sections() || place_.section().has_air;
    if (place_.has_sections()) in.air_Nm = place_.section().air_Nm;
    const Real back = Real(0.5) * step.progress - place_.within();
    const std::uint32_t cells = back > 0 ? static_cast<std::uint32_t>(back * per_spacing_) + 1 : 0;
    const std::uint32_t cell = place_.cell();
    in.cell = cell > cells ? cell - cells : 0;
    in.within = cell >= cells ? static_cast<Real>(cells) * spacing_ - back : Real(0);
    if (back <= 0) in.within = -back;
    return in;
  }

  // Some shifts a sample, first what each leaves outside, then how likely it is; then the verdict.
  void evaluate() noexcept {
    for (unsigned n = 0; n < per_sample_ && stage_ != 0; ++n) {
      const std::uint32_t at = stage_ - 1;
      if (at >= 2 * shifts()) {
        conclude_step();
        return;
      }
      if (at < shifts())
        weigh(core_, at);
      else
        rank(core_, at - shifts());
      ++stage_;
    }
  }
  [[gnu::noinline]] void conclude_step() noexcept {
    stage_ = 0;
    const MonitorState before = core_.alarm.state().state;
    conclude(core_);
    State& s = state_;
    ++s.steps;
    s.judged = true;
    s.state = core_.alarm.state().state;
    if (s.state == MonitorState::alarm && before != MonitorState::alarm) {
      ++s.alarms;
      recorder_.freeze();
    }
  }

  // ---- steps -----------------------------------------------------------------------------------

  void begin(Core& c, const Input& in) const noexcept {
    c.in = in;
    c.measured_Nm = in.mean_Nm - c.air_Nm;
    c.slack += drift_ * in.progress;
    c.moves = c.slack >= shift_step_ && in.join == Join::goes_on;
    if (c.slack >= shift_step_) c.slack -= shift_step_;
    c.all_air = in.has_air;
    if (in.join == Join::at_section) {
      c.before.add(c.here, cut_error_);
      c.here = {};
    }
    // What has been told is not told again of the next section.
    c.carried = c.value < c.alarm.threshold() ? c.value : Real(0);
    c.least = most_;
    c.best = shifts();
  }

  [[nodiscard]] Limits limits_at(const Input& in, std::uint32_t k) const noexcept {
    const Real x = (in.within + shift_of(k)) * per_spacing_;
    auto whole = static_cast<std::int32_t>(x);
    if (static_cast<Real>(whole) > x) --whole;
    const Real part = x - static_cast<Real>(whole);
    const auto last = static_cast<std::int32_t>(points_.size() - 1);
    auto clipped = [last](std::int32_t i) {
      return static_cast<std::size_t>(i < 0 ? 0 : i > last ? last : i);
    };
    const auto cell = static_cast<std::int32_t>(in.cell) + whole;
    const Point& a = points_[clipped(cell)];
    const Point& b = points_[clipped(cell + 1)];
    Limits l{a.torque_Nm + part * (b.torque_Nm - a.torque_Nm),
             a.lower_Nm < b.lower_Nm ? a.lower_Nm : b.lower_Nm,
             a.upper_Nm > b.upper_Nm ? a.upper_Nm : b.upper_Nm, a.expects() && b.expects()};
    const Real o = a.feed > 0 && in.feed > 0 ? in.feed / a.feed : in.feed_override;
    const Real size = l.torque < 0 ? -l.torque : l.torque;
    if (o < 1) {
      // Less feed, less torque in whatever sense the spindle turns.
      if (l.torque > 0)
        l.lower -= (Real(1) - o) * size;
      else
        l.upper += (Real(1) - o) * size;
    } else if (o > 1) {
      if (l.upper > 0) l.upper *= o;
      if (l.lower < 0) l.lower *= o;
    }
    return l;
  }

  void weigh(Core& c, std::uint32_t k) const noexcept {
    const Limits l = limits_at(c.in, k);
    Real outside = c.outside[k];
    Real error = c.error[k];
    const Real own_outside = outside;
    const Real own_error = error;
    if (c.in.join != Join::goes_on) {
      // Whatever the shift was, its least is what no course has explained so far.
      const std::uint32_t away = k > reach_ ? k - reach_ : reach_ - k;
      outside = c.in.join == Join::anywhere || away <= sync_ ? c.carried : most_;
      error = 0;
    }
    if (c.moves && k > 0 && c.last_outside < outside) {
      outside = c.last_outside;
      error = c.last_error;
    }
    if (c.moves && k + 1 < shifts() && c.outside[k + 1] < outside) {
      outside = c.outside[k + 1];
      error = c.error[k + 1];
    }
    c.last_outside = own_outside;
    c.last_error = own_error;
    const bool likely = outside <= c.carried + Real(1);
    const Real m = c.measured_Nm;
    Real z = 0;
    if (c.in.teeth != 0) {
      z = 1;  // wherever the program is
    } else if (l.expects) {
      const Real over = m > l.upper ? m - l.upper : m < l.lower ? l.lower - m : Real(0);
      const Real full = Real(0.125) * (l.upper - l.lower);
      z = over < full ? over / full : over > 0 ? Real(1) : Real(0);
    }
    outside = keep_ * outside + z;
    const Real off = m - l.torque;
    c.outside[k] = outside < most_ ? outside : most_;
    if (c.outside[k] < c.least) c.least = c.outside[k];
    c.error[k] = keep_ * error + (l.expects ? off * off : Real(0));
    const Real above = l.torque - c.in.air_Nm;
    const bool air = l.expects && (above < 0 ? -above : above) <= air_limit_;
    c.all_air = c.all_air && (air || !likely);
  }

  // Of several that explain the torque as well, the likeliest; of those, the one nearest to none.
  void rank(Core& c, std::uint32_t i) const noexcept {
    const std::uint32_t k = i % 2 == 0 ? reach_ - i / 2 : reach_ + 1 + i / 2;
    if (c.outside[k] > c.least + Real(0.25)) return;
    if (c.best < shifts() && !(c.error[k] < c.best_error)) return;
    c.best = k;
    c.best_error = c.error[k];
  }

  void conclude(Core& c) const noexcept {
    const Limits l = limits_at(c.in, c.best);
    c.value = c.least;
    c.shift = shift_of(c.best);
    if (l.expects) {
      c.expected_Nm = l.torque;
      c.lower_Nm = l.lower;
      c.upper_Nm = l.upper;
    }
    const Real raw = c.in.mean_Nm - c.in.air_Nm;
    if (air_limit_ > 0 && c.all_air && raw <= air_limit_ && raw >= -air_limit_)
      c.air_Nm += (raw - c.air_Nm) * Real(0.125);
    const Limits told = limits_at(c.in, reach_);
    if (told.expects) compare(c, told);
    const MonitorState before = c.alarm.state().state;
    c.alarm.process(c.least, SignalState::good);
    if (c.alarm.state().state == MonitorState::alarm && before != MonitorState::alarm)
      c.cause = c.suspected;
  }

  // The band leaves no doubt: it is nearer to the torque than to the air, in whatever sense the
  // spindle turns.
  static bool cuts(const Core& c, const Limits& l) noexcept {
    const Real half = Real(0.5) * (l.torque - c.in.air_Nm);
    return half > 0 ? l.lower - c.in.air_Nm > half : l.upper - c.in.air_Nm < half;
  }
  // Of what the program cuts there, at least half of the least.
  static bool is_cut(const Core& c, const Limits& l) noexcept {
    const Real m = c.measured_Nm - c.in.air_Nm;
    return l.torque > c.in.air_Nm ? m >= Real(0.5) * (l.lower - c.in.air_Nm)
                                  : m <= Real(0.5) * (l.upper - c.in.air_Nm);
  }
  void compare(Core& c, const Limits& l) const noexcept {
    if (cuts(c, l) && is_cut(c, l)) c.has_cut = true;
    if (is_in_for_good(c, l) && is_cut(c, l))
      c.here.add(c.measured_Nm - c.in.air_Nm, l.torque - c.in.air_Nm, change_at(c.in),
                 c.in.feed_override);
    if (c.in.teeth != 0)
      c.suspected = {TorqueCause::Kind::teeth, c.in.teeth};
    else if (c.measured_Nm > l.upper || c.measured_Nm < l.lower)
      c.suspected = cause_of(c, l);
    else if (c.least == 0)
      c.suspected = {};
  }
  // One cut all around, as far as the reference says how the tool is engaged.
  [[nodiscard]] bool is_in_for_good(const Core& c, const Limits& l) const noexcept {
    return c.in.cell < cuts_.size() ? cuts_[c.in.cell].kind == ExpectedCutKind::steady : cuts(c, l);
  }
  [[nodiscard]] TorqueBandChange<Real> change_at(const Input& in) const noexcept {
    return in.cell < changes_.size() ? changes_[in.cell] : TorqueBandChange<Real>{};
  }
  // Of a step outside the band.
  [[nodiscard, gnu::noinline]] TorqueCause cause_of(const Core& c, const Limits& l) const noexcept {
    using Kind = TorqueCause::Kind;
    const bool above = c.measured_Nm > l.upper;
    const Real limit = (above ? l.upper : l.lower) - c.in.air_Nm;
    const Real torque = l.torque - c.in.air_Nm;
    if (!cuts(c, l)) {
      // Less than half of what it may be, a tolerance in time away.
      if (above ? limit > 0 && torque < Real(0.5) * limit : limit < 0 && torque > Real(0.5) * limit)
        return Kind::cuts_air;
    } else if (!is_cut(c, l)) {
      return c.has_cut ? Kind::not_cut : Kind::never_cut;
    }
    if (!(limit > 0 || limit < 0)) return {};
    ComparedCut<Real> here = c.here;
    // Before the cut is in for good the limit stands for it.
    const bool at_least = !(here.steps > 0);
    if (at_least) here.add(c.measured_Nm - c.in.air_Nm, limit, change_at(c.in), c.in.feed_override);
    // Less torque is less in whatever sense the spindle turns.
    const bool more = here.expected_Nm > 0 ? here.measured_Nm > here.expected_Nm
                                           : here.measured_Nm < here.expected_Nm;
    return {more ? Kind::more : Kind::less, c.before.with(here, cut_error_, at_least)};
  }

  Core core_;
  State state_;
  Recorder recorder_;
  TurnSteps<Real> steps_;
  std::span<const Point> points_;
  std::span<const ExpectedCut<Real>> cuts_;
  std::span<const TorqueBandChange<Real>> changes_;
  std::span<const ToothLines<Real>> lines_;
  ToothCount<Real> teeth_;
  ProgramPlace<Real> place_;
  Real hole_ = 0;  // progress while nothing was heard
  Join join_ = Join::anywhere;
  bool steady_ = false;
  bool fresh_ = true;        // since start() the spindle has not changed its speed...
  bool heard_ = false;       // ...and made no step
  unsigned behind_gap_ = 0;  // unsteady revolutions that a gap still explains, and one
  bool pending_ = false;
  Input next_;  // a step that waits for the one behind it
  std::uint32_t stage_ = 0;

  Real spacing_ = 1;
  Real per_spacing_ = 1;
  Real shift_step_ = 1;
  std::uint32_t reach_ = 0;
  std::uint32_t sync_ = 0;
  Real drift_ = 0;
  Real keep_ = 0;
  Real most_ = 1;
  Real air_limit_ = 0;
  Real cut_error_ = 0;
  Real turn_rate_ = 0;
  Real rate_ = 0;  // samples a second; 0 = unknown
  bool over_path_ = false;
  unsigned per_sample_ = 1;
};

}  // namespace servosense
