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
// Cost on Cortex-M4F: 59 instructions for a counter without fault, else up to 250.
// Range: a drive may move at most half the counter's range in one period; position within +-2^31
// counts of its start in float.
// Numerical bound: counts are exact for 64-bit lifetimes; the float position is one rounding of the
// exact count.
// Bad at: a counter that wraps more than once between two samples (cannot be seen).
#pragma once

#include <cmath>
#include <concepts>
#include <cstdint>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

/// One drive at one servo instant, conditioned. Units: rad and Nm for a spindle, m and N for an
/// axis.
template <RealNumber Real>
struct DriveSample {
  Real increment = 0;       ///< motion since the previous sample
  Real position = 0;        ///< motion since the start
  Real turn_angle_rad = 0;  ///< angle within one turn of the motor or screw, [0, 2 pi)
  Real effort = 0;          ///< torque or force the motor exerts
  Quality quality = Quality::good;
};

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
  double max_acceleration = 0;
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
    std::int32_t step = 0;          // the last step of a counter without fault
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
    max_increment_ = static_cast<Real>(c.max_speed * c.sample_period_s);
    const double change = c.max_acceleration * c.sample_period_s * c.sample_period_s;
    const double rounding = kind_ == MotionKind::counts ? 2 * std::abs(c.unit_per_count) : 0.0;
    max_change_ = c.max_acceleration > 0 ? static_cast<Real>(change + rounding) : Real(0);
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
      const double counts = static_cast<double>(max_change_) / std::abs(c.unit_per_count);
      everyday_change_ =
          max_change_ > 0 && counts < 1e9 ? static_cast<std::uint32_t>(counts) : 0x7fffffffU;
    }
    reset();
  }

  void reset() noexcept {
    state_ = State{};
    everyday_span_ = 0;
  }

  DriveSample<Real> process(const RawDriveSample<Real>& raw) SERVOSENSE_NONBLOCKING {
    DriveSample<Real> out;
    process(raw, out);
    return out;
  }
  /// The same, written where it is needed. True for the everyday sample: quality good or held,
  /// increment and effort of moderate size (core/real_time.hpp); false says nothing.
  bool process(const RawDriveSample<Real>& raw, DriveSample<Real>& out) SERVOSENSE_NONBLOCKING {
    std::int32_t step = 0;
    Real effort = 0;
    // The everyday sample of a counter, in few instructions; the full path gives the same result.
    if (!is_everyday(raw, step, effort)) return process_in_full(raw, out);
    count_on(raw.counts, step, step, out);
    take_effort(raw, effort, out);
    return true;
  }

  /// For those that need only every so many samples (the mean of their efforts,
  /// the sum of their motion): takes one of those between. An everyday sample
  /// fills effort and quality alone; its motion is in the increment of the next
  /// sample that is not, or that process_last() takes.
  bool put_by(const RawDriveSample<Real>& raw, DriveSample<Real>& out) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    std::int32_t step = 0;
    Real effort = 0;
    if (!is_everyday(raw, step, effort)) return settle_and_process(raw, out);
    s.counts = raw.counts;
    s.step = step;
    s.owed += step;
    take_effort(raw, effort, out);
    return true;
  }
  /// process() with the motion of the samples that were put by.
  bool process_last(const RawDriveSample<Real>& raw,
                    DriveSample<Real>& out) SERVOSENSE_NONBLOCKING {
    std::int32_t step = 0;
    Real effort = 0;
    if (!is_everyday(raw, step, effort)) return settle_and_process(raw, out);
    const std::int32_t owed = state_.owed;
    state_.owed = 0;
    count_on(raw.counts, step, step + owed, out);
    take_effort(raw, effort, out);
    return true;
  }

  /// Motion that samples put by have not told yet.
  [[nodiscard]] Real owed() const noexcept { return static_cast<Real>(state_.owed) * scale_; }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  [[gnu::always_inline]] bool is_everyday(const RawDriveSample<Real>& raw, std::int32_t& step,
                                          Real& effort) noexcept {
    const State& s = state_;
    const Quality quality = raw.motion_quality | raw.effort_quality;
    effort = raw.effort * gain_;
    if (quality != Quality::good) {
      if (quality != Quality::held || raw.motion_quality != Quality::good) return false;
      effort = s.effort;
    }
    step = wrapped_low(raw.counts, s.counts);
    return is_moderate(effort) &&
           static_cast<std::uint32_t>(step) + everyday_step_ < everyday_span_ &&
           static_cast<std::uint32_t>(step - s.step) + everyday_change_ <= 2 * everyday_change_;
  }
  [[gnu::always_inline]] void take_effort(const RawDriveSample<Real>& raw, Real effort,
                                          DriveSample<Real>& out) noexcept {
    out.effort = state_.effort = effort;
    out.quality = raw.motion_quality | raw.effort_quality;
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
    const std::int32_t step = wrapped_low(raw.counts, s.counts);
    if (counting() && s.paced && raw.motion_quality == Quality::good &&
        static_cast<std::uint32_t>(step) + everyday_step_ < span &&
        static_cast<std::uint32_t>(step - s.step) + everyday_change_ <= 2 * everyday_change_)
      count_on(raw.counts, step, step, out);  // only the effort was at fault
    else
      condition_motion(raw, out);
    everyday_span_ =
        counting() && moderate_ && s.paced && s.effort_primed && s.effort_age == 0 ? span : 0;
    return false;
  }

  // condition_motion() for a counter without fault that moved less than a turn;
  // `moved`: since the last sample that has told its motion.
  [[gnu::always_inline]] void count_on(std::int64_t counts, std::int32_t step, std::int32_t moved,
                                       DriveSample<Real>& out) noexcept {
    State& s = state_;
    s.counts = counts;
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
    if (has(raw.effort_quality, kUnusable) || !is_finite(effort)) {
      out.quality |= raw.effort_quality | Quality::invalid;
      if (++s.effort_age > max_hold_) {
        out.quality |= Quality::gap;
        s.effort_age = max_hold_ + 1;
      }
    } else if (!has(raw.effort_quality, Quality::held)) {
      // Blocks start anew with the first value, and after a silence longer than what is bridged.
      if (s.effort_age > max_hold_ || !s.effort_primed) out.quality |= Quality::restarted;
      out.quality |= raw.effort_quality;
      s.effort = effort;
      s.effort_age = 0;
      s.effort_primed = true;
    } else {
      out.quality |= s.effort_primed ? Quality::held : Quality::held | Quality::settling;
    }
    out.effort = s.effort;
  }

  void condition_motion(const RawDriveSample<Real>& raw, DriveSample<Real>& out) noexcept {
    State& s = state_;
    out.quality |= raw.motion_quality;
    // A held reading (motion slower than the servo rate) is bridged like a missing one, but is no
    // fault.
    const bool held = has(raw.motion_quality, Quality::held);
    bool usable = !held && !has(raw.motion_quality, kUnusable) &&
                  (kind_ == MotionKind::counts || is_finite(raw.motion));
    // No drive means such a number, wherever it comes; as a jump it would be followed in the end.
    if (usable && kind_ != MotionKind::counts &&
        !(raw.motion <= max_motion_ && raw.motion >= -max_motion_)) {
      out.quality |= Quality::jump;
      usable = false;
    }
    if (usable && (!s.primed || s.motion_age > max_hold_)) {
      anchor(raw);
      out.quality |= Quality::restarted;
      s.increment =
          kind_ == MotionKind::velocity ? static_cast<Real>(raw.motion * period_) : Real(0);
      s.pace = s.increment;
    } else if (usable) {
      const std::int64_t step_counts =
          kind_ == MotionKind::counts ? wrapped(raw.counts, s.counts) : 0;
      Real moved = 0;
      if (kind_ == MotionKind::counts) {
        moved = as_real(step_counts) * scale_;
      } else if (kind_ == MotionKind::position) {
        moved = static_cast<Real>(raw.motion - s.motion);
      } else {
        moved = static_cast<Real>(period_ * (raw.motion + s.motion) * 0.5) + s.bridged;
      }
      const Real step = moved - s.bridged;
      // A speed is judged by itself, a position by how far it has come since the last good one.
      const bool speed = kind_ == MotionKind::velocity;
      const Real reach = speed ? static_cast<Real>(raw.motion * period_) : moved;
      const Real allowed = max_increment_ * static_cast<Real>(speed ? 1 : s.motion_age + 1);
      // How far it is from where the last pace would have led it, time for which has grown since.
      const auto periods = static_cast<Real>(s.motion_age + 1);
      const Real off =
          speed ? static_cast<Real>((raw.motion - s.motion) * period_) : moved - periods * s.pace;
      const Real tolerated = max_change_ * periods * (speed ? Real(1) : periods);
      if ((max_increment_ > 0 && (reach > allowed || reach < -allowed)) || !is_finite(reach) ||
          (max_change_ > 0 && s.paced && (off > tolerated || off < -tolerated))) {
        out.quality |= Quality::jump;
        usable = false;
      } else {
        s.increment = step;
        s.pace = speed || s.motion_age == 0 ? step : moved / periods;
        s.step = mean_step(step_counts, s.motion_age + 1);
        s.paced = true;
        s.counts = raw.counts;
        s.motion = raw.motion;
        s.total_counts += step_counts;
        turn(step_counts);
        if (kind_ == MotionKind::velocity) travel(step);
        s.bridged = 0;
        s.motion_age = 0;
      }
    }
    if (!usable) {
      if (!held) out.quality |= Quality::invalid;
      if (++s.motion_age > max_hold_) {
        out.quality |= Quality::gap;
        s.motion_age = max_hold_ + 1;
        s.increment = 0;
      } else {
        s.increment = s.pace;
        if (kind_ == MotionKind::velocity) travel(s.increment);
      }
      s.bridged += s.increment;
    }
    out.increment = s.increment;
    place(out);
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

  State state_;
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
  std::uint32_t max_hold_ = 0;
  unsigned low_shift_ = 0;
  std::int32_t direction_ = 1;  // sign of unit_per_count
  bool moderate_ = true;        // what is moved in less than a turn is of moderate size
  std::uint32_t everyday_step_ = 0;
  std::uint32_t everyday_change_ = 0x7fffffffU;
  // Steps from -everyday_step_ on that take the short path; 0 unless a counter of up to 32 bits
  // runs without fault.
  std::uint32_t everyday_span_ = 0;
};

}  // namespace servosense
