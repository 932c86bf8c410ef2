// From what a drive reports to what the blocks need: one clean step of motion and one effort per
// servo period.
//
// Purpose: takes encoder counts of any width, an angle, a position or only a speed, and a motor
// current, torque or force, each with its quality flags; gives the increment of motion since the
// last sample, the angle within a turn, and the effort in Nm or N. Blocks work on increments, so
// precision does not decay however far the drive has travelled.
//   counts:   increment = ((now - last) mod 2^bits, as a signed number) * unit_per_count
//   position: increment = now - last (double precision)
//   velocity: increment = T (v + v_last) / 2 (trapezoid)
// Faults: an unusable motion sample is bridged at the pace of the last good interval; when good
// samples return, the next increment makes up the difference, so position is never lost. (Bridging
// with that make-up step instead would grow without bound when motion is slower than the servo
// rate.) An unusable effort repeats the last one. After `max_hold_samples` the sample is marked
// `gap`; the first good sample after that is marked `restarted`, and every block behind empties its
// windows.
// Delay: none.
// Cost on Cortex-M4F: 108 instructions for a counter without fault, else up to 530.
// Range: a drive may move at most half the counter's range in one period; position within +-2^31
// counts of its start in float.
// Numerical bound: counts are exact for 64-bit lifetimes; the float position is one rounding of the
// exact count.
// Bad at: a counter that wraps more than once between two samples (cannot be seen).
#pragma once

#include <cmath>
#include <concepts>
#include <cstdint>

#include "servosense/core/drive_sample.hpp"
#include "servosense/core/effort_watch.hpp"
#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

/// One drive at one servo instant, as it arrives.
template <RealNumber Real>
struct RawDriveSample {
  std::int64_t counts = 0;  ///< encoder counter, when the drive reports counts
  double motion = 0;        ///< angle or position or speed, when it reports one of those
  Real effort = 0;          ///< current [A], torque [Nm] or force [N]
  Quality motion_quality = Quality::good;
  Quality effort_quality = Quality::good;
};

enum class MotionKind : std::uint8_t { counts, position, velocity };

struct DriveInputConfig {
  MotionKind kind = MotionKind::counts;
  double sample_period_s = 125e-6;
  double unit_per_count = 0;      ///< rad or m per count; used for counts
  unsigned counter_bits = 32;     ///< width of the counter, 1..64; used for counts
  double unit_per_turn = kTwoPi;  ///< rad or m per turn of the motor or screw
  double effort_per_unit = 1;     ///< Nm/A or N/A; 1 when the effort is already a torque or a force
  double max_speed = 0;           ///< rad/s or m/s beyond which a step is a jump; 0 switches it off
  /// rad/s2 or m/s2 beyond which a change of speed is a jump, two counts of rounding allowed for; 0
  /// switches it off. No drive comes near 800 m/s2 or 4e5 rad/s2, not even in a collision.
  /// With it, counts beside their track are one, too, at periods of 1 ms and below. (The digits of
  /// a position in a text, and so its noise, come and go.)
  double max_acceleration = 0;
  double max_effort = 0;  ///< Nm or N that no drive gives; 0 switches it off
  /// Whether the effort is watched (core/effort_watch.hpp), and what is known of it.
  bool watch_effort = false;
  double effort_update_s = 0;     ///< between two values, as stated; 0: as they come
  unsigned max_hold_samples = 8;  ///< longest fault that is bridged
  unsigned group = 1;             ///< samples that process_last() tells the motion of, at most
};

template <RealNumber Real>
class DriveInput {
 public:
  using Config = DriveInputConfig;
  struct State {
    std::int64_t counts = 0;        // last good counter reading
    std::int64_t total_counts = 0;  // unwrapped, from the start
    double motion = 0;              // last good angle, position or speed
    double origin = 0;              // first good position
    std::int32_t turn_counts = 0;   // within the turn, in the direction of positive motion
    Real increment = 0;             // last increment given out
    Real pace = 0;                  // mean increment between the last two good samples
    std::int32_t step = 0;          // the last step of a counter without fault...
    std::int32_t step_before = 0;   // ...and the one before
    std::int32_t owed = 0;          // steps put by
    Real bridged = 0;               // increments given out since the last good sample
    Real effort = 0;
    Real travelled = 0;            // velocity input: integral of speed...
    Real travelled_carry = 0;      // ...and its rounding error (Kahan)
    std::uint32_t motion_age = 0;  // samples since the last good one
    std::uint32_t effort_age = 0;
    bool primed = false;
    bool paced = false;  // `pace` is known: two good samples since the start
    bool effort_primed = false;
    bool stuck = false;  // it stands where it should not have stopped
    Real change = 0;     // largest change of the pace but for `slope` lately, fading by 1/e in
                         // half a second
    std::uint8_t efforts_doubted = 0;  // of this sample and the one before, a bit each
    Real aside = 0;                    // of a doubtful reading: how far beside its track; 0: none
    bool told = false;                 // that it is beside it
    bool lost = false;                 // samples were lost since the last good one
    Real slope = 0;                    // change of the pace from sample to sample, as last learned
    Real learnt_pace = 0;              // then
    std::uint32_t learnt = 0;          // times that `change` has faded, as many as it takes
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (c.kind == MotionKind::counts) {
      if (!(is_finite(c.unit_per_count) && c.unit_per_count != 0))
        return Status::invalid("unit_per_count", "must be a finite number other than zero");
      if (c.counter_bits < 1 || c.counter_bits > 64)
        return Status::invalid("counter_bits", "must be within 1 and 64");
      const double turn = c.unit_per_turn / c.unit_per_count;
      if (!(turn >= 1 || turn <= -1) || !(turn <= 1073741824.0 && turn >= -1073741824.0))
        return Status::invalid("unit_per_turn", "must be 1 to 2^30 counts");
    }
    if (!(c.unit_per_turn > 0 && is_finite(c.unit_per_turn)))
      return Status::invalid("unit_per_turn", "must be positive");
    if (!is_finite(c.effort_per_unit) || c.effort_per_unit == 0)
      return Status::invalid("effort_per_unit", "must be a finite number other than zero");
    if (c.group < 1) return Status::invalid("group", "must be at least 1");
    if (!(c.max_speed >= 0)) return Status::invalid("max_speed", "must not be negative");
    if (!(c.max_acceleration >= 0))
      return Status::invalid("max_acceleration", "must not be negative");
    if (!(c.max_effort >= 0)) return Status::invalid("max_effort", "must not be negative");
    if (!(c.effort_update_s >= 0 && c.effort_update_s < 1e6 * c.sample_period_s))
      return Status::invalid("effort_update_s", "must be at least 0, below a million samples");
    return {};
  }

  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    kind_ = c.kind;
    bits_ = c.counter_bits;
    scale_ = static_cast<Real>(c.unit_per_count);
    unit_per_turn_ = c.unit_per_turn;
    max_motion_ = c.unit_per_turn * 1099511627776.0;  // 2^40 turns, or turns per second
    period_ = c.sample_period_s;
    gain_ = static_cast<Real>(c.effort_per_unit);
    max_hold_ = c.max_hold_samples;
    max_effort_ = c.max_effort > 0 ? static_cast<Real>(c.max_effort) : Real(1e18);
    effort_.configure({c.watch_effort, c.sample_period_s, c.effort_update_s, c.max_hold_samples});
    const double stretch = kLearn_s / c.sample_period_s;
    learn_every_ = stretch < 5 ? 5 : stretch < 61 ? static_cast<std::uint32_t>(stretch) : 61;
    max_increment_ = static_cast<Real>(c.max_speed * c.sample_period_s);
    const double change = c.max_acceleration * c.sample_period_s * c.sample_period_s;
    const double rounding = kind_ == MotionKind::counts ? 2 * std::abs(c.unit_per_count) : 0.0;
    max_change_ = c.max_acceleration > 0 ? static_cast<Real>(change + rounding) : Real(0);
    least_stop_ =
        static_cast<Real>(kBrakes * c.max_acceleration * c.sample_period_s * c.sample_period_s);
    follows_ = kind_ == MotionKind::counts && c.max_acceleration > 0 &&
               c.sample_period_s < 1.5 * kFollowed_s;
    if (kind_ == MotionKind::counts) {
      const double turn =
          c.unit_per_turn / (c.unit_per_count < 0 ? -c.unit_per_count : c.unit_per_count);
      counts_per_turn_ = static_cast<std::int32_t>(std::lround(turn));
      turn_scale_ = static_cast<Real>(kTwoPi / turn);
      direction_ = c.unit_per_count < 0 ? -1 : 1;
      moderate_ = is_moderate(static_cast<Real>(c.unit_per_turn));
      low_shift_ = bits_ <= 32 ? 32 - bits_ : 0;
      // Less than a turn, so that the angle needs no division, and no jump.
      everyday_step_ = (static_cast<std::uint32_t>(counts_per_turn_) - 1) / c.group;
      const double allowed = turn * c.max_speed * c.sample_period_s / c.unit_per_turn;
      if (c.max_speed > 0 && allowed < static_cast<double>(everyday_step_))
        everyday_step_ = static_cast<std::uint32_t>(allowed);
      grain_ = std::abs(scale_);
    }
    reset();
  }

  void reset() noexcept {
    state_ = State{};
    everyday_span_ = 0;
    effort_.reset();
    until_learn_ = learn_every_;
    allow_change();
  }
  /// After reset(): what is usual is learned on other samples, by `part` of `parts` later, than by
  /// a drive beside this one.
  void stagger(std::uint32_t part, std::uint32_t parts) noexcept {
    until_learn_ = learn_every_ + part * learn_every_ / parts;
  }

  DriveSample<Real> process(const RawDriveSample<Real>& raw) SERVOSENSE_NONBLOCKING {
    DriveSample<Real> out;
    process(raw, out);
    return out;
  }
  /// The same, written where it is needed. True for the everyday sample: quality good or held,
  /// increment and effort of moderate size (core/real_time.hpp); false says nothing.
  bool process(const RawDriveSample<Real>& raw, DriveSample<Real>& out) SERVOSENSE_NONBLOCKING {
    Taken in;
    // The everyday sample of a counter, in few instructions; the full path gives the same result.
    if (!is_everyday(raw, in)) return process_in_full(raw, out);
    count_on(raw.counts, in.step, in.step, out);
    take_effort(raw, in, out);
    return true;
  }

  /// For those that need only every so many samples (the mean of their efforts,
  /// the sum of their motion): takes one of those between. An everyday sample
  /// fills effort and quality alone; its motion is in the increment of the next
  /// sample that is not, or that process_last() takes.
  bool put_by(const RawDriveSample<Real>& raw, DriveSample<Real>& out) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    Taken in;
    if (!is_everyday(raw, in)) return settle_and_process(raw, out);
    s.counts = raw.counts;
    s.step_before = s.step;
    s.step = in.step;
    s.owed += in.step;
    take_effort(raw, in, out);
    return true;
  }
  /// process() with the motion of the samples that were put by.
  bool process_last(const RawDriveSample<Real>& raw,
                    DriveSample<Real>& out) SERVOSENSE_NONBLOCKING {
    Taken in;
    if (!is_everyday(raw, in)) return settle_and_process(raw, out);
    const std::int32_t owed = state_.owed;
    state_.owed = 0;
    count_on(raw.counts, in.step, in.step + owed, out);
    take_effort(raw, in, out);
    return true;
  }

  /// Motion that samples put by have not told yet.
  [[nodiscard]] Real owed() const noexcept { return static_cast<Real>(state_.owed) * scale_; }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  struct Taken {
    std::int32_t step = 0;
    Real effort = 0;
    Real change = 0;  // of the effort
    bool fresh = true;
  };
  [[gnu::always_inline]] bool is_everyday(const RawDriveSample<Real>& raw, Taken& in) noexcept {
    const State& s = state_;
    const Quality quality = raw.motion_quality | raw.effort_quality;
    in.effort = s.effort;
    if (quality == Quality::good) in.effort = raw.effort * gain_;
    in.change = in.effort - s.effort;
    if (--until_learn_ == 0) learn(in.change);
    if (quality != Quality::good) {
      if (quality != Quality::held || raw.motion_quality != Quality::good) return false;
      in.fresh = false;
    }
    in.step = wrapped_low(raw.counts, s.counts);
    return effort_.everyday(in.change) &&
           static_cast<std::uint32_t>(in.step) + everyday_step_ < everyday_span_ &&
           static_cast<std::uint32_t>(in.step - s.step - slope_step_) + everyday_change_ <=
               2 * everyday_change_;
  }
  [[gnu::always_inline]] void take_effort(const RawDriveSample<Real>& raw, const Taken& in,
                                          DriveSample<Real>& out) noexcept {
    effort_.take(in.change, in.fresh, in.step);
    out.effort = state_.effort = in.effort;
    out.quality = raw.motion_quality | raw.effort_quality;
  }

  // Every 8 ms: what is usual fades.
  [[gnu::noinline]] void learn(Real effort_change) noexcept {
    State& s = state_;
    until_learn_ = learn_every_;
    effort_.learn(s.effort, effort_change);
    s.change -= s.change * Real(1.0 / 64);
    // A reading in doubt is judged by what was known when it came.
    if (s.aside > 0) return;
    const bool sound = s.paced && s.motion_age == 0;
    s.slope = sound && s.learnt > 0
                  ? (s.increment - s.learnt_pace) / static_cast<Real>(learn_every_)
                  : Real(0);
    s.learnt_pace = s.increment;
    if (sound && s.learnt < kLearnt) ++s.learnt;
    allow_change();
  }
  // What the pace may change by without a look, in counts: as it usually does, two of rounding.
  void allow_change() noexcept {
    if (kind_ != MotionKind::counts) return;
    const Real usual = usual_change() / grain_ + Real(0.5);
    const Real slope = state_.slope / scale_;
    const bool small = follows_ && usual < Real(1e6) && slope < Real(1e6) && slope > Real(-1e6);
    everyday_change_ = small ? static_cast<std::uint32_t>(usual) : 0x7fffffffU;
    slope_step_ =
        small ? static_cast<std::int32_t>(slope < 0 ? slope - Real(0.5) : slope + Real(0.5)) : 0;
  }
  [[nodiscard]] Real rounding() const noexcept { return 2 * grain_; }
  [[nodiscard]] Real usual_change() const noexcept {
    const Real usual = state_.change > rounding() ? state_.change : rounding();
    return max_change_ > 0 && usual > max_change_ ? max_change_ : usual;
  }

  // The motion that is owed, then the sample.
  [[gnu::noinline]] bool settle_and_process(const RawDriveSample<Real>& raw,
                                            DriveSample<Real>& out) noexcept {
    State& s = state_;
    const Real moved = owed();
    if (kind_ == MotionKind::counts) {
      s.total_counts += s.owed;
      turn_by(s.owed);
      s.owed = 0;
      // Samples put by have left the pace as it was: a whole count off, or
      // more, it is not theirs.
      const Real pace = static_cast<Real>(s.step) * scale_;
      const Real off = pace - s.pace;
      if (s.paced && s.motion_age == 0 && off * off > Real(0.9) * scale_ * scale_)
        s.increment = s.pace = pace;
    }
    process_in_full(raw, out);
    out.increment += moved;
    return false;
  }

  [[gnu::noinline]] bool process_in_full(const RawDriveSample<Real>& raw,
                                         DriveSample<Real>& out) noexcept {
    const State& s = state_;
    const std::uint32_t span = 2 * everyday_step_ + 1;
    const auto counting = [&] {
      return kind_ == MotionKind::counts && bits_ <= 32 && s.primed && s.motion_age == 0;
    };
    out.quality = Quality::good;
    condition_effort(raw, out);
    const auto doubted = static_cast<unsigned>(state_.efforts_doubted << 1U) & 2U;
    state_.efforts_doubted =
        static_cast<std::uint8_t>(doubted | (has(out.quality, Quality::doubtful) ? 1U : 0U));
    const std::int32_t step = wrapped_low(raw.counts, s.counts);
    if (counting() && s.paced && s.aside == 0 && raw.motion_quality == Quality::good &&
        static_cast<std::uint32_t>(step) + everyday_step_ < span &&
        static_cast<std::uint32_t>(step - s.step - slope_step_) + everyday_change_ <=
            2 * everyday_change_)
      count_on(raw.counts, step, step, out);  // only the effort was at fault
    else
      condition_motion(raw, out);
    everyday_span_ = counting() && moderate_ && s.paced && s.effort_primed && s.effort_age == 0 &&
                             s.aside == 0 && !effort_.doubts()
                         ? span
                         : 0;
    return false;
  }

  // condition_motion() for a counter without fault that moved less than a turn;
  // `moved`: since the last sample that has told its motion.
  [[gnu::always_inline]] void count_on(std::int64_t counts, std::int32_t step, std::int32_t moved,
                                       DriveSample<Real>& out) noexcept {
    State& s = state_;
    s.counts = counts;
    s.step_before = s.step;
    s.step = step;
    s.total_counts += moved;
    turn_by(moved);
    s.increment = s.pace = static_cast<Real>(step) * scale_;
    out.increment = static_cast<Real>(moved) * scale_;
    out.position = counted_position();
    out.turn_angle_rad = turn_angle();
  }

  void condition_effort(const RawDriveSample<Real>& raw, DriveSample<Real>& out) noexcept {
    State& s = state_;
    const Real effort = raw.effort * gain_;
    const bool fresh = !has(raw.effort_quality, Quality::held);
    const Real size = effort < 0 ? -effort : effort;
    Quality fault = raw.effort_quality & kUnusable;
    if (!is_finite(effort) || (fresh && !(size <= max_effort_))) fault |= Quality::invalid;
    EffortFinding finding = EffortFinding::sound;
    if (fault == Quality::good) {
      finding = hear_effort(raw, effort, fresh);
      if (finding == EffortFinding::stale) {
        fault = Quality::stale;
        s.effort_age = max_hold_;
      }
    }
    if (fault != Quality::good) {
      out.quality |= raw.effort_quality | fault | Quality::invalid;
      if (++s.effort_age > max_hold_) {
        out.quality |= Quality::gap;
        s.effort_age = max_hold_ + 1;
      }
      out.effort = s.effort;
      return;
    }
    if (finding == EffortFinding::spike) out.quality |= Quality::jump;
    if (finding == EffortFinding::doubtful) out.quality |= Quality::doubtful;
    if (fresh) {
      // Blocks start anew with the first value, and after a silence longer than what is bridged.
      if (s.effort_age > max_hold_ || !s.effort_primed) out.quality |= Quality::restarted;
      out.quality |= raw.effort_quality;
      if (finding != EffortFinding::doubtful) s.effort = effort;  // else it waits
      s.effort_age = 0;
      s.effort_primed = true;
    } else {
      out.quality |= s.effort_primed ? Quality::held : Quality::held | Quality::settling;
    }
    out.effort = s.effort;
  }
  EffortFinding hear_effort(const RawDriveSample<Real>& raw, Real effort, bool fresh) noexcept {
    const State& s = state_;
    const std::int32_t moved = s.increment > 0 ? 1 : s.increment < 0 ? -1 : 0;
    const std::int32_t step =
        kind_ == MotionKind::counts && bits_ <= 32 ? wrapped_low(raw.counts, s.counts) : moved;
    const bool anew = !s.effort_primed || s.effort_age > max_hold_;
    return effort_.hear(effort, s.effort, fresh, anew, step);
  }

  // Against the last good reading, `periods` ago.
  struct Reading {
    std::int64_t step = 0;
    Real moved = 0;
    Real off = 0;  // beside where the last pace would have led it
    Real periods = 1;
    bool impossible = false;
  };
  [[nodiscard]] Reading read(const RawDriveSample<Real>& raw) const noexcept {
    const State& s = state_;
    Reading r;
    r.step = kind_ == MotionKind::counts ? wrapped(raw.counts, s.counts) : 0;
    if (kind_ == MotionKind::counts)
      r.moved = as_real(r.step) * scale_;
    else if (kind_ == MotionKind::position)
      r.moved = static_cast<Real>(raw.motion - s.motion);
    else
      r.moved = static_cast<Real>(period_ * (raw.motion + s.motion) * 0.5) + s.bridged;
    r.periods = static_cast<Real>(s.motion_age + 1);
    // A speed is judged by itself, a position by how far it has come since the last good one.
    const bool speed = kind_ == MotionKind::velocity;
    const Real reach = speed ? static_cast<Real>(raw.motion * period_) : r.moved;
    const Real allowed = max_increment_ * (speed ? Real(1) : r.periods);
    // Time for which the pace has grown since.
    r.off =
        speed ? static_cast<Real>((raw.motion - s.motion) * period_) : r.moved - r.periods * s.pace;
    const Real tolerated = max_change_ * r.periods * (speed ? Real(1) : r.periods);
    r.impossible = (max_increment_ > 0 && (reach > allowed || reach < -allowed)) ||
                   !is_finite(reach) ||
                   (max_change_ > 0 && s.paced && (r.off > tolerated || r.off < -tolerated));
    return r;
  }

  /// What a possible reading is. A mass that has been pushed off its track does not keep its pace:
  /// what stands aside by more than three times what the pace changes by lately, and stays so or
  /// comes back, has not moved; what goes on at a rate was pushed. Nothing stops a mass between two
  /// samples of 1 ms or less: a contact takes a quarter of the period at which the mass swings on
  /// it. A reading that repeats itself to the bit meanwhile is stuck. Where samples were lost, and
  /// the drive is where its pace leads it in another number of periods, so many have passed: the
  /// clock was set.
  enum class Track : std::uint8_t { on, doubtful, back, aside, untimed };
  Track follow(const Reading& r) noexcept {
    State& s = state_;
    if (!follows_ || !s.paced) return Track::on;
    const Real turns = Real(0.5) * r.periods * (r.periods + 1);
    const Real off = r.off - s.slope * turns;
    const Real size = off < 0 ? -off : off;
    const Real usual = usual_change();
    if (s.motion_age == 0) {
      if (s.learnt == kLearnt && size > kBeyond * usual + rounding()) {
        s.aside = size;
        return Track::doubtful;
      }
      grow(size);
      return Track::on;
    }
    const Real grown = usual * turns;
    if (s.aside == 0) {  // held or bridged: it may have come anywhere
      const bool beside = s.lost && s.learnt == kLearnt && size > 2 * grown;
      return beside && periods_passed(r) > 0 ? Track::untimed : Track::on;
    }
    if (size <= grown) return Track::back;
    // A stop that the effort tells of, too, is one.
    if (s.efforts_doubted != 0 && s.motion_age <= max_hold_) {
      s.stuck = false;
      grow(size);
      return Track::on;
    }
    s.stuck = s.stuck || (r.moved == 0 && (s.pace > least_stop_ || s.pace < -least_stop_));
    if (s.stuck || 2 * size < 3 * s.aside) return Track::aside;
    grow(size);
    return Track::on;
  }
  // For which the drive went on at its pace, as far as that tells; else 0.
  [[nodiscard]] std::uint32_t periods_passed(const Reading& r) const noexcept {
    const State& s = state_;
    const Real within = usual_change() + rounding();
    const Real pace = s.pace < 0 ? -s.pace : s.pace;
    const Real moved = s.pace < 0 ? -r.moved : r.moved;
    if (pace < 4 * within || moved < pace / 2 || moved > kPassed * pace) return 0;
    const auto n = static_cast<std::uint32_t>(moved / pace + Real(0.5));
    const Real off = moved - static_cast<Real>(n) * pace;
    return (off < 0 ? -off : off) <= static_cast<Real>(n) * within ? n : 0;
  }
  void grow(Real size) noexcept {
    State& s = state_;
    if (size <= s.change) return;
    s.change = size;
    allow_change();
  }

  void condition_motion(const RawDriveSample<Real>& raw, DriveSample<Real>& out) noexcept {
    State& s = state_;
    out.quality |= raw.motion_quality;
    // A held reading (motion slower than the servo rate) is bridged like a missing one, but is no
    // fault.
    const bool held = has(raw.motion_quality, Quality::held);
    bool usable = !held && !has(raw.motion_quality, kUnusable) &&
                  (kind_ == MotionKind::counts || is_finite(raw.motion));
    bool fault = !held;
    // No drive means such a number, wherever it comes; as a jump it would be followed in the end.
    if (usable && kind_ != MotionKind::counts &&
        !(raw.motion <= max_motion_ && raw.motion >= -max_motion_)) {
      out.quality |= Quality::jump;
      usable = false;
    }
    if (usable && s.stuck && repeats(raw)) {
      out.quality |= Quality::stuck;
      usable = false;
    }
    if (usable && (!s.primed || s.motion_age > max_hold_)) {
      anchor(raw);
      out.quality |= Quality::restarted;
      s.increment =
          kind_ == MotionKind::velocity ? static_cast<Real>(raw.motion * period_) : Real(0);
      s.pace = s.increment;
    } else if (usable) {
      const Reading r = read(raw);
      const Track track = r.impossible ? Track::aside : follow(r);
      if (track == Track::aside || track == Track::doubtful) {
        fault = track == Track::aside;
        if (r.impossible && s.aside > 0 && r.moved == 0 && kind_ != MotionKind::velocity)
          s.stuck = true;
        out.quality |= !fault ? Quality::doubtful : s.stuck ? Quality::stuck : Quality::jump;
        if (r.impossible && s.aside == 0) {
          s.aside = r.off < 0 ? -r.off : r.off;
          s.told = true;
        }
        usable = false;
      } else {
        if (track == Track::back && !s.told) out.quality |= Quality::jump;
        const Real step = r.moved - s.bridged;
        s.increment = step;
        const bool untimed = track == Track::untimed;
        const std::uint32_t passed = untimed ? periods_passed(r) : s.motion_age + 1;
        if (untimed) out.quality |= Quality::restarted;
        s.pace = kind_ == MotionKind::velocity || s.motion_age == 0
                     ? step
                     : r.moved / static_cast<Real>(passed);
        s.step_before = s.step;
        s.step = mean_step(r.step, passed);
        s.paced = true;
        s.counts = raw.counts;
        s.motion = raw.motion;
        s.total_counts += r.step;
        turn(r.step);
        if (kind_ == MotionKind::velocity) travel(step);
        s.bridged = 0;
        s.motion_age = 0;
        s.aside = 0;
        s.told = s.stuck = s.lost = false;
      }
    }
    if (!usable) {
      if (fault) out.quality |= Quality::invalid;
      s.lost = s.lost || fault;
      if (++s.motion_age > max_hold_) {
        out.quality |= Quality::gap;
        s.motion_age = max_hold_ + 1;
        s.increment = 0;
      } else {
        s.increment = s.motion_age == 1 ? s.pace + last_change() : s.pace;
        if (kind_ == MotionKind::velocity) travel(s.increment);
      }
      s.bridged += s.increment;
    }
    out.increment = s.increment;
    place(out);
  }
  // To the bit, what was read last.
  [[nodiscard]] bool repeats(const RawDriveSample<Real>& raw) const noexcept {
    return kind_ == MotionKind::counts ? wrapped(raw.counts, state_.counts) == 0
                                       : raw.motion == state_.motion;
  }

  void anchor(const RawDriveSample<Real>& raw) noexcept {
    State& s = state_;
    if (!s.primed) s.origin = raw.motion;
    if (s.primed && kind_ == MotionKind::counts) {
      const std::int64_t step = wrapped(raw.counts, s.counts);
      s.total_counts += step;
      turn(step);
    } else if (kind_ == MotionKind::counts) {
      turn(raw.counts);
    }
    s.counts = raw.counts;
    s.motion = raw.motion;
    s.bridged = 0;
    s.motion_age = 0;
    s.primed = true;
    s.paced = false;
    s.slope = 0;
    slope_step_ = 0;
    s.aside = 0;
    s.told = s.stuck = s.lost = false;
  }
  // Of the pace, where it is more than rounding: what a single sample is bridged with, too.
  [[nodiscard]] Real last_change() const noexcept {
    const std::int32_t change = state_.step - state_.step_before;
    if (!follows_ || (change <= 2 && change >= -2)) return 0;
    const Real size = static_cast<Real>(change) * scale_;
    const Real most = usual_change();
    return size > most ? most : size < -most ? -most : size;
  }

  // Difference of two readings of a `bits_` wide counter as a signed number.
  [[nodiscard]] std::int64_t wrapped(std::int64_t now, std::int64_t last) const noexcept {
    const auto difference = static_cast<std::uint64_t>(now) - static_cast<std::uint64_t>(last);
    if (bits_ <= 32) {
      const unsigned shift = 32 - bits_;
      const auto low = static_cast<std::uint32_t>(difference);
      return static_cast<std::int32_t>(low << shift) >> shift;
    }
    const unsigned shift = 64 - bits_;
    return static_cast<std::int64_t>(difference << shift) >> shift;
  }

  // The same for counters of up to 32 bits.
  [[nodiscard]] std::int32_t wrapped_low(std::int64_t now, std::int64_t last) const noexcept {
    const std::uint32_t low = static_cast<std::uint32_t>(static_cast<std::uint64_t>(now)) -
                              static_cast<std::uint32_t>(static_cast<std::uint64_t>(last));
    return static_cast<std::int32_t>(low << low_shift_) >> low_shift_;
  }

  // 64 bits are a library call on a microcontroller, so only where they are needed.
  static std::int32_t mean_step(std::int64_t counts, std::uint32_t periods) noexcept {
    const auto low = static_cast<std::int32_t>(counts);
    return low == counts && periods < 0x80000000U
               ? low / static_cast<std::int32_t>(periods)
               : static_cast<std::int32_t>(counts / static_cast<std::int64_t>(periods));
  }
  static Real as_real(std::int64_t counts) noexcept {
    const auto low = static_cast<std::int32_t>(counts);
    return low == counts ? static_cast<Real>(low) : static_cast<Real>(counts);
  }

  [[nodiscard]] Real counted_position() const noexcept {
    // In float one 32-bit conversion: 64 bits are a library call on a microcontroller.
    if constexpr (std::same_as<Real, double>)
      return static_cast<Real>(state_.total_counts) * scale_;
    else
      return static_cast<Real>(static_cast<std::int32_t>(state_.total_counts)) * scale_;
  }

  [[nodiscard]] Real turn_angle() const noexcept {
    return static_cast<Real>(state_.turn_counts) * turn_scale_;
  }

  void turn(std::int64_t step) noexcept {
    if (kind_ != MotionKind::counts) return;
    const auto small = static_cast<std::int32_t>(step);
    turn_by(small == step ? small % counts_per_turn_
                          : static_cast<std::int32_t>(step % counts_per_turn_));
  }
  // By less than a turn.
  void turn_by(std::int32_t step) noexcept {
    std::int32_t t = state_.turn_counts + step * direction_;
    if (static_cast<std::uint32_t>(t) >= static_cast<std::uint32_t>(counts_per_turn_))
      t += t < 0 ? counts_per_turn_ : -counts_per_turn_;
    state_.turn_counts = t;
  }

  void travel(Real step) noexcept {
    State& s = state_;
    const Real carried = step - s.travelled_carry;
    const Real sum = s.travelled + carried;
    s.travelled_carry = (sum - s.travelled) - carried;
    s.travelled = sum;
  }

  void place(DriveSample<Real>& out) noexcept {
    State& s = state_;
    if (kind_ == MotionKind::counts) {
      out.position = counted_position() + s.bridged;
      out.turn_angle_rad = turn_angle();
      return;
    }
    const double position = kind_ == MotionKind::position
                                ? s.motion - s.origin + static_cast<double>(s.bridged)
                                : static_cast<double>(s.travelled);
    out.position = static_cast<Real>(position);
    const double origin = kind_ == MotionKind::position ? s.origin : 0.0;
    double turns = (position + origin) / unit_per_turn_;
    turns -= static_cast<double>(static_cast<std::int64_t>(turns));
    if (turns < 0) turns += 1;
    out.turn_angle_rad = static_cast<Real>(turns * kTwoPi);
  }

  // Longest period at which a track is followed. In two samples of more a contact may stop a mass:
  // a quarter of its period, 2.2 ms for 200 kg on 1e8 N/m.
  static constexpr double kFollowed_s = 1e-3;
  // Of max_acceleration: 32 m/s2, 16000 rad/s2. No controller brakes harder, so a drive that goes
  // faster than one sample of it does not come to rest in one.
  static constexpr double kBrakes = 0.04;
  static constexpr Real kPassed = 100;  // periods that a pace tells of
  static constexpr double kLearn_s = 61 * 125e-6;
  static constexpr std::uint32_t kLearnt = 8;  // 60 ms
  static constexpr Real kBeyond = 3;           // times what is usual, as of the effort

  State state_;
  EffortWatch<Real> effort_;
  std::uint32_t until_learn_ = 1, learn_every_ = 61;
  Real max_effort_ = 0;
  Real grain_ = 0;  // a count
  MotionKind kind_ = MotionKind::counts;
  unsigned bits_ = 32;
  std::int32_t counts_per_turn_ = 1;
  Real scale_ = 0;
  Real turn_scale_ = 0;
  double unit_per_turn_ = kTwoPi;
  double max_motion_ = 0;
  double period_ = 0;
  Real gain_ = 1;
  Real max_increment_ = 0;
  Real max_change_ = 0;  // of the increment, from one sample to the next
  Real least_stop_ = 0;  // pace from which no drive stops in a sample
  bool follows_ = false;
  std::uint32_t max_hold_ = 0;
  unsigned low_shift_ = 0;
  std::int32_t direction_ = 1;  // sign of unit_per_count
  bool moderate_ = true;        // what is moved in less than a turn is of moderate size
  std::uint32_t everyday_step_ = 0;
  std::uint32_t everyday_change_ = 0x7fffffffU;
  std::int32_t slope_step_ = 0;  // counts that the pace is to change by in a sample
  // Steps from -everyday_step_ on that take the short path; 0 unless a counter of up to 32 bits
  // runs without fault.
  std::uint32_t everyday_span_ = 0;
};

}  // namespace servosense
