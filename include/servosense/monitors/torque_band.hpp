// Torque band: measured cutting torque against what was predicted or taught, with tolerance in
// magnitude and in time.
//
// Purpose: finds whatever moves the torque off its reference: a wrong or missing tool, a wrong or
// misplaced workpiece, excess wear, a failed drive (Bertok 1984, sections 4.6.3 and 5.4). The
// reference is made by make_torque_band (identify/torque_band_reference.hpp) and stays in the
// caller's memory: points at equal distances of program time [s] or path [m], all lengths below in
// that unit.
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
// are on the safe side. Where all shifts expect air, the air level follows, if air_limit_Nm allows.
// Discretisation: revolutions end between samples, the last sample is shared. A spindle that stands
// is averaged over four steps.
// Delay: half a step, two samples for each shift, and the steps that collect alarm_steps (three
// when the torque is out by h and more).
// Cost on Cortex-M4F: 123 instructions with 41 shifts and a step of 20 ms, 639 for the worst
// sample.
// Range: |torque| < 1e15 Nm; a step must last two samples for each shift, else it grows.
// Numerical bound: J <= 2 alarm_steps + 1, a contraction; position exact to half a rounding a
// sample within its point of the reference.
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

namespace servosense {

template <RealNumber Real>
struct TorqueBandPoint {
  Real torque_Nm = 0;  ///< expected
  Real lower_Nm = 0;
  Real upper_Nm = 0;
};

struct TorqueBandConfig {
  double spacing = 0;         ///< of the reference's points, program time [s] or path [m]
  double step = 0;            ///< of the program between verdicts, at least
  double max_shift = 0;       ///< that the reference may be early or late
  double shift_step = 0;      ///< grid of shifts; half the band's tolerance in time or finer
  double max_drift = 0.02;    ///< of the shift, part of the progress; the source saw 0.012
  double memory_steps = 200;  ///< that a contradiction is remembered for
  double alarm_steps = 3;     ///< outside the band that raise an alarm; 0 = off
  double warning_fraction = 0.5;
  double release_fraction = 0.4;
  unsigned release_steps = 8;
  double air_limit_Nm = 0;  ///< largest air level that is subtracted; 0 = none
  double tolerated_stand_ins = 0.25;
};

/// Mean over whole revolutions: run-out and tooth passing average out.
template <RealNumber Real>
class TurnMean {
 public:
  struct State {
    Real sum = 0, samples = 0, turned_rad = 0;  // of the revolution under way
    Real whole_sum = 0, whole_samples = 0;      // of complete ones
  };
  void reset() noexcept { state_ = State{}; }
  /// Forgets what take() has given; the revolution under way goes on.
  void next() noexcept { state_.whole_sum = state_.whole_samples = 0; }
  /// True with the sample that completes a revolution, of which it may belong to the next in part.
  bool add(Real value, Real increment_rad) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.sum += value;
    s.samples += Real(1);
    s.turned_rad += increment_rad;
    const Real turned = s.turned_rad < 0 ? -s.turned_rad : s.turned_rad;
    if (turned < kTurn) return false;
    const Real step = increment_rad < 0 ? -increment_rad : increment_rad;
    Real beyond = (turned - kTurn) / step;
    if (!(beyond < 1)) beyond = 0;  // more than a turn in a sample
    s.whole_sum += s.sum - beyond * value;
    s.whole_samples += s.samples - beyond;
    s.sum = beyond * value;
    s.samples = beyond;
    s.turned_rad = beyond * increment_rad;
    return true;
  }
  /// Samples in complete revolutions.
  [[nodiscard]] Real samples() const noexcept { return state_.whole_samples; }
  [[nodiscard]] Real mean() const noexcept { return state_.whole_sum / state_.whole_samples; }
  /// Takes the revolution under way as it is, for a spindle that stands.
  void force() noexcept {
    state_.whole_sum += state_.sum;
    state_.whole_samples += state_.samples;
    state_.sum = state_.samples = state_.turned_rad = 0;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  static constexpr Real kTurn = static_cast<Real>(kTwoPi);
  State state_;
};

/// Shifts: most points of the shift grid, odd.
template <RealNumber Real, std::size_t Shifts = 65>
class TorqueBandMonitor {
  static_assert(Shifts % 2 == 1);

 public:
  using Config = TorqueBandConfig;
  using Point = TorqueBandPoint<Real>;
  static constexpr std::size_t kEvidenceStride = 16;

  /// One step of the program.
  struct Input {
    Real mean_Nm = 0;
    std::uint32_t cell = 0;  ///< middle of the step: point of the reference...
    Real within = 0;         ///< ...and beyond it
    Real progress = 0;
    Real feed_override = 1;
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
    Real least = 0;
    std::uint32_t best = 0;
    Real best_error = 0;
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
    if (!(c.max_drift >= 0 && c.max_drift < 1))
      return Status::invalid("max_drift", "must be at least 0 and below 1");
    if (!(c.memory_steps >= 1 && c.memory_steps <= 1e6))
      return Status::invalid("memory_steps", "must be within 1 and 1e6");
    if (!(c.air_limit_Nm >= 0 && is_finite(c.air_limit_Nm)))
      return Status::invalid("air_limit_Nm", "must be zero (none) or positive");
    if (!(c.tolerated_stand_ins >= 0 && c.tolerated_stand_ins < 1))
      return Status::invalid("tolerated_stand_ins", "must be at least 0 and below 1");
    if (!(c.alarm_steps >= 0 && c.alarm_steps <= 0.5 * c.memory_steps))
      return Status::invalid("alarm_steps", "must be at least 0, half of memory_steps at most");
    return AlarmLogic<Real>::validate(logic(c));
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    auto real = [](double x) { return static_cast<Real>(x); };
    spacing_ = real(c.spacing);
    per_spacing_ = real(1 / c.spacing);
    step_ = real(c.step);
    shift_step_ = real(c.shift_step);
    reach_ = static_cast<std::uint32_t>(c.max_shift / c.shift_step + 1e-9);
    drift_ = real(c.max_drift);
    keep_ = real(1 - 1 / c.memory_steps);
    most_ = real(2 * c.alarm_steps + 1);
    air_limit_ = real(c.air_limit_Nm);
    tolerated_ = real(c.tolerated_stand_ins);
    core_.alarm.configure(logic(c));
    reset();
  }
  /// Forgets everything but the reference.
  void reset() noexcept {
    const AlarmLogic<Real> alarm = core_.alarm;
    core_ = Core{};
    core_.alarm = alarm;
    core_.alarm.reset();
    state_ = State{};
    recorder_.reset();
    cell_ = 0;
    within_ = 0;
    stage_ = 0;
    clear_step();
  }
  /// Misuse contract: `points` must outlive its use, two points at least. Stops a program under
  /// way.
  void set_reference(std::span<const Point> points) noexcept {
    points_ = points;
    state_.started = false;
    stage_ = 0;
  }
  /// The program is at point `cell` of the reference, give or take max_shift: at its start, and
  /// where the controller knows better. Requires a reference.
  void start(std::uint32_t cell = 0) noexcept {
    cell_ = cell;
    within_ = 0;
    state_.started = points_.size() >= 2;
    any_shift();
    core_.value = 0;
    state_.state =
        core_.alarm.process(0, state_.started ? SignalState::filling : SignalState::standstill);
  }

  /// One servo period: cutting torque, spindle increment, how far the program has moved (override
  /// included), feed override (1 when unknown), and what is known against any of them.
  MonitorState process(Real torque_Nm, Real increment_rad, Real advance, Real feed_override,
                       Quality quality) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    ++s.sample;
    if (stage_ != 0) evaluate();
    const bool progress_known = advance >= 0 && advance < Real(1e6) * spacing_;
    if (s.started && progress_known) {
      within_ += advance;
      if (within_ >= spacing_) step_cells();
    }
    const Real check = torque_Nm * torque_Nm * Real(1e-30) + increment_rad * increment_rad +
                       feed_override * feed_override;
    if (has(quality, kBreaks | kFaulty) || !(check < Real(1e4)) || !progress_known)
      return take_fault(quality, progress_known ? advance : Real(0));
    if (!s.started) {
      if (s.state == MonitorState::idle) return s.state;
      return s.state = core_.alarm.process(0, SignalState::standstill);
    }
    if (advance == 0) return s.state;  // feed hold: the program stands, nothing is expected
    progress_ += advance;
    override_ += feed_override;
    used_ += Real(1);
    const bool turned = turns_.add(torque_Nm, increment_rad);
    if (progress_ >= step_ && stage_ == 0 && (turned || progress_ >= 4 * step_)) close_step();
    return s.state;
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  [[nodiscard]] const Core& core() const noexcept { return core_; }
  [[nodiscard]] const AlarmLogic<Real>& alarm() const noexcept { return core_.alarm; }
  /// Point of the reference that the program has reached.
  [[nodiscard]] std::uint32_t cell() const noexcept { return cell_; }
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
  static constexpr Quality kFaulty = kUnusable | Quality::stuck;
  struct Limits {
    Real torque, lower, upper;
  };

  static AlarmLogicConfig logic(const Config& c) noexcept {
    return {c.alarm_steps, c.warning_fraction, c.release_fraction, c.release_steps, 1};
  }
  [[nodiscard]] std::uint32_t shifts() const noexcept { return 2 * reach_ + 1; }
  [[nodiscard]] Real shift_of(std::uint32_t k) const noexcept {
    return (static_cast<Real>(k) - static_cast<Real>(reach_)) * shift_step_;
  }

  // ---- samples ---------------------------------------------------------------------------------

  void step_cells() noexcept {
    const auto cells = static_cast<std::uint32_t>(within_ * per_spacing_);
    cell_ += cells;
    within_ -= static_cast<Real>(cells) * spacing_;
    if (within_ < 0) within_ = 0;
    // Over for every shift: nothing is expected any more.
    if (cell_ >
        points_.size() + static_cast<std::uint32_t>(shift_of(2 * reach_) * per_spacing_) + 1)
      state_.started = false;
  }
  void clear_step() noexcept {
    turns_.reset();
    progress_ = override_ = used_ = bad_ = 0;
  }
  void any_shift() noexcept {
    core_.outside = {};
    core_.error = {};
    core_.slack = Real(0.5) * shift_step_;
    stage_ = 0;
    clear_step();
  }
  [[gnu::noinline]] MonitorState take_fault(Quality quality, Real advance) noexcept {
    State& s = state_;
    ++s.stand_ins;
    s.judged = false;
    if (has(quality, kBreaks)) {
      // Nobody knows how far the program has come meanwhile.
      if (progress_ > 0 || stage_ != 0 || core_.value > 0) {
        ++s.restarts;
        any_shift();
        core_.value = 0;
      }
      const bool gap = has(quality, Quality::gap);
      return s.state = core_.alarm.process(0, gap ? SignalState::faulty : SignalState::filling);
    }
    bad_ += Real(1);
    progress_ += advance;
    return s.state = core_.alarm.process(0, SignalState::faulty);
  }
  [[gnu::noinline]] void close_step() noexcept {
    if (!(turns_.samples() > 0)) turns_.force();
    const bool usable = bad_ <= tolerated_ * (used_ + bad_);
    Input in;
    in.mean_Nm = turns_.mean();
    in.progress = progress_;
    in.feed_override = override_ / used_;
    // Middle of the step, as a point and a rest that is not negative.
    const Real back = Real(0.5) * progress_ - within_;
    const std::uint32_t cells = back > 0 ? static_cast<std::uint32_t>(back * per_spacing_) + 1 : 0;
    in.cell = cell_ > cells ? cell_ - cells : 0;
    in.within = cell_ >= cells ? static_cast<Real>(cells) * spacing_ - back : Real(0);
    if (back <= 0) in.within = -back;
    turns_.next();
    progress_ = override_ = used_ = bad_ = 0;
    if (!usable) return;
    recorder_.before(core_, in);
    begin(core_, in);
    stage_ = 1;
  }

  // One shift a sample, first what it leaves outside, then how likely it is; then the verdict.
  void evaluate() noexcept {
    const std::uint32_t at = stage_ - 1;
    if (at < 2 * shifts()) {
      if (at < shifts())
        weigh(core_, at);
      else
        rank(core_, at - shifts());
      ++stage_;
      return;
    }
    conclude_step();
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
    c.moves = c.slack >= shift_step_;
    if (c.moves) c.slack -= shift_step_;
    c.all_air = true;
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
             a.upper_Nm > b.upper_Nm ? a.upper_Nm : b.upper_Nm};
    const Real o = in.feed_override;
    if (o < 1 && l.torque > 0) l.lower -= (Real(1) - o) * l.torque;
    if (o > 1 && l.upper > 0) l.upper *= o;
    return l;
  }

  void weigh(Core& c, std::uint32_t k) const noexcept {
    const Limits l = limits_at(c.in, k);
    Real outside = c.outside[k];
    Real error = c.error[k];
    const Real own_outside = outside;
    const Real own_error = error;
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
    const Real m = c.measured_Nm;
    const Real over = m > l.upper ? m - l.upper : m < l.lower ? l.lower - m : Real(0);
    const Real full = Real(0.125) * (l.upper - l.lower);
    const Real z = over < full ? over / full : over > 0 ? Real(1) : Real(0);
    outside = keep_ * outside + z;
    const Real off = m - l.torque;
    c.outside[k] = outside < most_ ? outside : most_;
    if (c.outside[k] < c.least) c.least = c.outside[k];
    c.error[k] = keep_ * error + off * off;
    const Real expected = l.torque < 0 ? -l.torque : l.torque;
    c.all_air = c.all_air && expected <= air_limit_;
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
    c.expected_Nm = l.torque;
    c.lower_Nm = l.lower;
    c.upper_Nm = l.upper;
    const Real raw = c.in.mean_Nm;
    if (air_limit_ > 0 && c.all_air && raw <= air_limit_ && raw >= -air_limit_)
      c.air_Nm += (raw - c.air_Nm) * Real(0.125);
    c.alarm.process(c.least, SignalState::good);
  }

  Core core_;
  State state_;
  Recorder recorder_;
  TurnMean<Real> turns_;
  std::span<const Point> points_;
  std::uint32_t cell_ = 0;
  Real within_ = 0;
  std::uint32_t stage_ = 0;
  Real progress_ = 0;
  Real override_ = 0;
  Real used_ = 0;
  Real bad_ = 0;

  Real spacing_ = 1;
  Real per_spacing_ = 1;
  Real step_ = 1;
  Real shift_step_ = 1;
  std::uint32_t reach_ = 0;
  Real drift_ = 0;
  Real keep_ = 0;
  Real most_ = 1;
  Real air_limit_ = 0;
  Real tolerated_ = 0;
};

}  // namespace servosense
