// Disturbance observer: cutting force or torque from motor effort and motion.
//
// Purpose: what acts on the drive besides what the model knows, low-passed twice
// (Koike 2016, eq. 2-23 for the spindle; 2-20 for a feed axis, in units of the stage):
//   est = g/(s+g) { h/(s+h) (effort - resistance) - D v - J s v },   v = s h/(s+h) x
// g the disturbance cutoff, h the velocity cutoff. The effort goes through the same low-pass that
// the pseudo-derivative puts on the velocity, so both sides stay in phase; so do the
// position-driven terms (Coulomb sign, gravity, effects), which are subtracted before that filter:
// at a reversal the friction that the motor delivers and the friction that the model expects cancel
// sample for sample. With exact nominals est/F = g h / ((s+g)(s+h)), gain 1 at rest (eq. 2-22).
// Discretisation: Tustin by default (dsp/first_order.hpp).
// Two forms of the inertia term, equal to rounding (eq. 2-11):
//   differential   - J [s g/(s+g)] v              (same pole as the low-pass: one filter holds
//   both) integral-only  + g/(s+g) [g J v] - g J v      (subtracts two large numbers: use double)
// Sign: positive when the load opposes positive motion. Multi-rate: hold a slower effort, run at
// the encoder rate (Koike 3.1).
// Samples that stand for several (`averaged` n) have their effort (n-1)/2 servo periods before the
// position they lead to; the motion is taken from there as well, by linear interpolation.
// Delay: (1/g + 1/h) seconds at low frequency.
// Cost on Cortex-M4F: 78 instructions without effects, 377 with the three of bench/blocks.hpp.
// Range: 0 < g T, h T < 2.
// Numerical bound: contraction, no drift; differential form in float within 2u (E + g J v) / (g T),
// u = 6e-8, E the largest effort (rounding enters each filter and leaves after 1/(g T) samples).
// Bad at: drive-train resonances (single inertia, unless the model has flexible-coupling), a torque
// constant that is off (offset in proportion to the effort), creeping through reversals below the
// friction knee.
#pragma once

#include "servosense/core/drive_sample.hpp"
#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/whole.hpp"
#include "servosense/dsp/first_order.hpp"
#include "servosense/model/drive_model.hpp"

namespace servosense {

enum class ObserverForm : unsigned char { differential, integral_only };

/// `Drive`: DriveModelConfig, or DriveModelView where memory counts.
template <typename Drive>
struct DisturbanceObserverConfigWith {
  double sample_period_s = 125e-6;
  double disturbance_cutoff_rad_s = 500;  ///< g
  double velocity_cutoff_rad_s = 500;     ///< h
  Discretisation discretisation = Discretisation::tustin;
  Drive drive;
  /// Samples at the servo rate that each one stands for: mean effort, summed motion.
  unsigned averaged = 1;

  /// The same observer of another `drive`.
  template <typename Other>
  [[nodiscard]] constexpr DisturbanceObserverConfigWith<Other> with(
      const Other& other) const noexcept {
    return {sample_period_s, disturbance_cutoff_rad_s, velocity_cutoff_rad_s, discretisation, other,
            averaged};
  }
};
using DisturbanceObserverConfig = DisturbanceObserverConfigWith<DriveModelConfig>;
using DisturbanceObserverView = DisturbanceObserverConfigWith<DriveModelView>;

/// `c` with the effects of its drive left where they are: `c` must outlive the use of what is
/// returned.
[[nodiscard]] constexpr DisturbanceObserverView view_of(
    const DisturbanceObserverConfig& c) noexcept {
  return c.with(view_of(c.drive));
}

template <RealNumber Real, ObserverForm Form = ObserverForm::differential>
class DisturbanceObserver {
 public:
  using Config = DisturbanceObserverConfig;
  struct State {
    MotionState<Real> motion;  // as the model saw it; all but the increment only where effects ask
    Real reported_effort = 0;
    Real estimate = 0;          // cutting force [N] or torque [Nm]
    std::uint32_t samples = 0;  // since the last restart, stops at the settling length
    Quality quality = Quality::settling;
  };

  static Status validate(const Config& c) noexcept { return validate(view_of(c)); }
  static Status validate(const DisturbanceObserverView& c) noexcept {
    const FirstOrderConfig g{c.disturbance_cutoff_rad_s, c.sample_period_s, c.discretisation};
    const FirstOrderConfig h{c.velocity_cutoff_rad_s, c.sample_period_s, c.discretisation};
    if (const Status s = validate_first_order(g); !s.ok())
      return Status::invalid("disturbance_cutoff_rad_s", s.reason());
    if (const Status s = validate_first_order(h); !s.ok())
      return Status::invalid("velocity_cutoff_rad_s", s.reason());
    if (c.averaged < 1) return Status::invalid("averaged", "must be at least 1");
    return DriveModel<Real>::validate(drive_of(c));
  }

  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept { configure(view_of(c)); }
  /// The effects are read while this runs, and not kept.
  void configure(const DisturbanceObserverView& c) noexcept {
    const FirstOrderConfig g{c.disturbance_cutoff_rad_s, c.sample_period_s, c.discretisation};
    const FirstOrderConfig h{c.velocity_cutoff_rad_s, c.sample_period_s, c.discretisation};
    model_.configure(drive_of(c));
    velocity_.configure(h);
    effort_filter_.configure(h);
    disturbance_filter_.configure(g);
    acceleration_.configure(g);
    acceleration_gain_ = acceleration_.step() * model_.inertia();
    inertia_gain_ = static_cast<Real>(c.disturbance_cutoff_rad_s) * model_.inertia();
    averaged_ = c.averaged;
    lag_ = static_cast<Real>(0.5 - 0.5 / c.averaged);
    // Ten time constants of each filter leave 5e-5 of any start transient.
    settling_ = whole(10 * (1 / c.disturbance_cutoff_rad_s + 1 / c.velocity_cutoff_rad_s) /
                          c.sample_period_s +
                      2);
    reset();
  }

  void reset() noexcept {
    state_ = State{};
    path_ = Path::full;
    model_.reset();
    velocity_.reset();
    effort_filter_.reset();
    disturbance_filter_.reset();
    acceleration_.reset();
  }

  /// Friction that has changed since configure(), little by little: the filters go on. Not where
  /// the model has effects that share it out (a load behind play or a spring).
  void set_friction(Real viscous, Real coulomb) noexcept { model_.set_friction(viscous, coulomb); }

  /// Returns the estimate [N or Nm]. While the signal is marked `gap` the last one is kept.
  Real process(const DriveSample<Real>& in) SERVOSENSE_NONBLOCKING {
    // The everyday sample, in few instructions; the full path gives the same result.
    if (path_ == Path::full || has(in.quality, Quality::gap | Quality::restarted) ||
        !is_moderate(in.increment + in.effort))
      return process_in_full(in);
    return averaged_ > 1 ? advance_mean(in) : advance(in);
  }
  /// process() for a sample that has been checked: increment and effort of moderate size, neither
  /// gap nor restarted.
  Real advance(const DriveSample<Real>& in) SERVOSENSE_NONBLOCKING { return advance_by<false>(in); }
  /// The same with `averaged` above one.
  Real advance_mean(const DriveSample<Real>& in) SERVOSENSE_NONBLOCKING {
    return advance_by<true>(in);
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  // full: the first two samples, and with effects every one.
  enum class Path : unsigned char { full, settling, settled };

  template <bool Mean>
  [[gnu::always_inline]] Real advance_by(const DriveSample<Real>& in) noexcept {
    State& s = state_;
    s.quality = in.quality;
    if (path_ != Path::settled) {
      if (path_ == Path::full) return process_in_full(in);
      settle();
    }
    const Real increment = Mean ? at_mean(in.increment) : in.increment;
    s.motion.increment = increment;
    s.reported_effort = in.effort;
    const Real before = velocity_.state().output;
    const Real velocity = velocity_.advance(increment);
    return estimate(velocity, velocity - before, in.effort - model_.plain_resistance(increment));
  }

  // A mean effort lies earlier than the position that the motion leads to.
  [[gnu::always_inline]] Real at_mean(Real increment) noexcept {
    const Real shifted = increment + lag_ * (last_increment_ - increment);
    last_increment_ = increment;
    return shifted;
  }

  static DriveModelView drive_of(const DisturbanceObserverView& c) noexcept {
    DriveModelView drive = c.drive;
    drive.effects.sample_period_s = c.sample_period_s;
    return drive;
  }

  [[gnu::noinline]] Real process_in_full(const DriveSample<Real>& in) noexcept {
    State& s = state_;
    if (has(in.quality, Quality::gap)) {
      s.quality = in.quality;
      return s.estimate;
    }
    if (!is_moderate(in.increment + in.effort)) {  // repeat the sample before
      const bool known = s.samples > 0;
      s.quality = in.quality | Quality::invalid;
      if (!known) return s.estimate;
      DriveSample<Real> again = in;
      again.increment = averaged_ > 1 ? last_increment_ : s.motion.increment;
      again.effort = s.reported_effort;
      again.quality |= Quality::invalid;
      return process(again);
    }
    if (has(in.quality, Quality::restarted)) s.samples = 0;
    if (s.samples == 0) last_increment_ = in.increment;
    // A counter tells its speed only from the second sample on, so the filters start there again.
    const bool starting = s.samples < 2;
    s.motion.position = in.position - lag_ * in.increment;
    s.motion.increment = at_mean(in.increment);
    s.motion.turn_angle_rad = in.turn_angle_rad;
    s.motion.effort = s.reported_effort = in.effort;
    if (s.samples == 0) model_.restart(s.motion);
    model_.correct(s.motion);
    if (starting) {
      velocity_.prime(s.motion.increment);
      model_.start(s.motion);
    }
    const Real before = velocity_.state().output;
    s.motion.velocity = velocity_.advance(s.motion.increment);
    s.motion.effort = model_.acting_effort(in.effort, s.motion);
    const Real change = s.motion.velocity - before;
    if (!model_.plain()) s.motion.acceleration = acceleration_.advance(change);
    const Real drive = s.motion.effort - model_.resistance(s.motion);
    if (starting) start(drive);
    s.quality = in.quality;
    settle();
    if (!model_.plain() || s.samples < 2)
      path_ = Path::full;
    else if (path_ == Path::full)
      path_ = Path::settling;
    return estimate(s.motion.velocity, change, drive);
  }

  // Counts the samples towards settling.
  void settle() noexcept {
    if (state_.samples < settling_) {
      ++state_.samples;
      state_.quality |= Quality::settling;
    } else if (path_ == Path::settling) {
      path_ = Path::settled;
    }
  }

  // From velocity, its change since the last sample, and `drive`, the acting effort minus
  // resistance, to the estimate.
  Real estimate(Real velocity, Real change, Real drive) noexcept {
    const Real brace = effort_filter_.advance(drive) - model_.viscous() * velocity;
    if constexpr (Form == ObserverForm::differential) {
      return state_.estimate = disturbance_filter_.advance(brace, -acceleration_gain_ * change);
    } else {
      const Real momentum = inertia_gain_ * velocity;
      return state_.estimate = disturbance_filter_.advance(brace + momentum) - momentum;
    }
  }

  // Filters begin in the steady state of the first samples, so that a constant load is there from
  // the start.
  void start(Real drive) noexcept {
    effort_filter_.prime(drive);
    acceleration_.reset();
    const Real velocity = velocity_.state().output;
    const Real brace = drive - model_.viscous() * velocity;
    disturbance_filter_.prime(
        Form == ObserverForm::differential ? brace : brace + inertia_gain_ * velocity);
  }

  State state_;
  PseudoDerivative<Real> velocity_;
  LowPass<Real> effort_filter_;
  LowPass<Real> disturbance_filter_;
  PseudoDerivative<Real> acceleration_;  // for effects
  Real acceleration_gain_ = 0;
  Real inertia_gain_ = 0;
  std::uint32_t settling_ = 0;
  unsigned averaged_ = 1;
  Real lag_ = 0;  // of a mean behind its last sample, in sample periods
  Real last_increment_ = 0;
  Path path_ = Path::full;
  DriveModel<Real> model_;  // large, so last: what every sample needs stays in reach
};

}  // namespace servosense
