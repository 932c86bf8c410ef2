// Backlash: play between motor and load.
//   d = x - x_load, free for |d| <= b/2; beyond, a flank pushes:
//   F = k (|d| - b/2) + c d'   toward the load, never pulling
//   m2 x_load'' = F - D2 x_load' - C2 S(x_load) - L - F_cut
// The load has the drive's load_inertia_share of the inertia, load_friction_share of viscous and
// Coulomb friction, and all of the constant load (gravity pulls at the stage), so the gap opens
// when the transmitted force changes sign, not when the velocity does. A flank is stiff but not
// rigid: load on flank swings at 200 Hz with damping ratio 0.3 (typical of ball screws), or, with
// `flexible-coupling`, as that effect says: play and spring in series.
// Discretisation: leapfrog, second order, with the motor's velocity linear over the sample; as many
// equal steps per sample as hold w h below 0.2, at most 64, fixed when configured.
// Numerical bound: the flanks hold the load, states are relative to the motor.
// Bad at: the flank's stiffness and the load's share of friction, which are assumed, not fitted.
#pragma once

#include <cmath>
#include <cstdint>

#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/elastoplastic_sign.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class Backlash {
 public:
  static constexpr EffectInfo info = effect_info("backlash");
  static constexpr EffectTraits traits = {
      .equation = "load behind play: F = k (|d| - b/2) + c d' on a flank, 0 between",
      .where = "velocity-reversal",
      .signature = "the inertia of the load is missing while the gap is crossed",
      .confused_with = {"presliding-hysteresis", "flexible-coupling", "lead-error"},
      .splitting_motion =
          "twenty slow reversals of 0.2 mm and as many hard ones; a scale on the stage shows the "
          "width itself",
      .sized = true,
      .search = {{{EffectRole::searched, 0.8, 200, EffectRange::of_knee, 24}}}};

  static constexpr double kFlank_hz = 200;  ///< load on a flank, motor held
  static constexpr double kFlankDamping = 0.3;
  static constexpr std::uint32_t kMostSteps = 64;

  struct State {
    Real deflection = 0;  // d
    Real load_velocity = 0;
    Real half_change = 0;     // of its velocity, in half a step at the last acceleration
    Real motor_velocity = 0;  // mean over the last sample
    Real transmitted = 0;
  };

  static Status validate(const EffectSetting& /*setting*/, const DriveFacts& drive) noexcept {
    if (!(drive.inertia > 0)) return Status::invalid("inertia", "must be known for backlash");
    if (!(steps_for(drive) <= kMostSteps))
      return Status::invalid("sample_period_s", "is too long for the flanks of the backlash");
    return {};
  }
  void configure(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    const Flank flank = flank_of(drive);
    const double mass = flank.share * drive.inertia;
    shares_ = LoadShares{flank.share, friction_share(drive), 1};
    const double w = flank.frequency_rad_s;
    double steps = steps_for(drive);
    steps = steps < kMostSteps ? steps : kMostSteps;
    steps_ = static_cast<std::uint32_t>(steps);
    half_width_ = static_cast<Real>(setting.scalar(0) / 2);
    per_step_ = static_cast<Real>(1 / steps);
    step_s_ = static_cast<Real>(drive.sample_period_s / steps);
    per_second_ = static_cast<Real>(1 / drive.sample_period_s);
    half_step_per_mass_ =
        static_cast<Real>(mass > 0 ? drive.sample_period_s / steps / mass / 2 : 0);
    stiffness_ = static_cast<Real>(mass * w * w);
    damping_ = static_cast<Real>(2 * flank.damping_ratio * w * mass);
    viscous_ = static_cast<Real>(shares_.friction * drive.viscous);
    coulomb_ = static_cast<Real>(shares_.friction * drive.coulomb);
    constant_load_ = static_cast<Real>(drive.constant_load);
    const double side = drive.constant_load > 0 ? 0.5 : drive.constant_load < 0 ? -0.5 : 0;
    leaning_ = static_cast<Real>(side * setting.scalar(0) +
                                 (mass > 0 ? drive.constant_load / (mass * w * w) : 0));
    sign_.configure(drive.friction_knee);
    reset();
  }
  /// At rest the load leans on the flank to which the constant load presses it.
  void reset() noexcept {
    state_ = State{leaning_, 0, 0, 0, constant_load_};
    sign_.reset();
  }
  void start(const MotionState<Real>& m) noexcept {
    const Real velocity = m.increment * per_second_;
    state_ = State{state_.deflection, velocity, 0, velocity, state_.transmitted};
  }
  Real transmitted(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    // Motor velocity is linear over the sample: its mean is that of the increment, its slope the
    // change since the sample before.
    const Real mean = m.increment * per_second_;
    const Real change = (mean - s.motor_velocity) * per_step_;
    s.motor_velocity = mean;
    Real motor = mean - Real(0.5) * change * static_cast<Real>(steps_);  // at the start
    for (std::uint32_t i = 0; i < steps_; ++i) {
      const Real halfway = s.load_velocity + s.half_change;
      s.deflection += step_s_ * (motor + Real(0.5) * change - halfway);
      motor += change;
      const Real predicted = halfway + s.half_change;
      s.transmitted = flank_force(s.deflection, motor - predicted);
      const Real friction =
          viscous_ * predicted + coulomb_ * sign_.process(step_s_ * halfway) + constant_load_;
      s.half_change = half_step_per_mass_ * (s.transmitted - friction - m.cutting);
      s.load_velocity = halfway + s.half_change;
    }
    return s.transmitted;
  }
  [[nodiscard]] LoadShares load_shares() const noexcept { return shares_; }
  [[nodiscard]] Real deflection() const noexcept { return state_.deflection; }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  struct Flank {
    double share;            // of the inertia
    double frequency_rad_s;  // of the load with the motor held
    double damping_ratio;
  };
  static Flank flank_of(const DriveFacts& drive) noexcept {
    if (drive.coupling == nullptr)
      return {drive.load_inertia_share, kTwoPi * kFlank_hz, kFlankDamping};
    const EffectSetting& c = *drive.coupling;
    const double held = std::sqrt(1 - c.scalar(2));
    return {c.scalar(2), kTwoPi * c.scalar(0) * held, c.scalar(1) * held};
  }
  static double friction_share(const DriveFacts& drive) noexcept {
    const bool told = drive.coupling != nullptr && drive.coupling->parameters[3].count > 0;
    return told ? drive.coupling->scalar(3) : drive.load_friction_share;
  }
  // Steps that resolve both springs of the load: flank and friction below the knee.
  static double steps_for(const DriveFacts& drive) noexcept {
    const Flank flank = flank_of(drive);
    const double knee = friction_share(drive) * drive.coulomb / drive.friction_knee;
    const double mass = flank.share * drive.inertia;
    const double w2 = flank.frequency_rad_s * flank.frequency_rad_s + (mass > 0 ? knee / mass : 0);
    return std::ceil(std::sqrt(w2) * drive.sample_period_s / 0.2);
  }

  Real flank_force(Real d, Real rate) const noexcept {
    const Real sign = d < 0 ? Real(-1) : Real(1);
    const Real pressed = d * sign - half_width_;
    const Real push = stiffness_ * pressed + damping_ * rate * sign;
    return pressed > 0 && push > 0 ? push * sign : Real(0);
  }

  State state_;
  LoadShares shares_;
  ElastoplasticSign<Real> sign_;  // of the load's motion
  std::uint32_t steps_ = 1;
  Real half_width_ = 0;
  Real per_step_ = 1;
  Real step_s_ = 0;
  Real per_second_ = 0;
  Real half_step_per_mass_ = 0;
  Real stiffness_ = 0;
  Real damping_ = 0;
  Real viscous_ = 0;
  Real coulomb_ = 0;
  Real constant_load_ = 0;
  Real leaning_ = 0;  // deflection at rest
};

}  // namespace servosense
