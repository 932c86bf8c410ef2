// Two masses: the load hangs on the motor by a spring and a damper.
//   d = x - x_load,  F = k d + c d',  m2 = share * J,  m1 = J - m2
//   m2 x_load'' = F - q (D x_load' + C S(x_load)) - F_cut
//   k = m1 m2 / J * w^2,   c = m1 m2 / J * 2 zeta w
// w = 2 pi resonance_hz is the resonance of the free pair and zeta its damping ratio; with the
// motor held, the load swings at the antiresonance w sqrt(1 - share) (Koike 2016, eq. 2-12 to
// 2-14). q = friction_share of the drive's viscous and Coulomb friction D, C is at the load, as
// that of guideways is, and winds the spring up; left out, all of it stays at the motor.
// Discretisation: exact for a motor that moves steadily between samples, hence stable at any
// resonance. A motor that accelerates evenly bends away from that chord and would be transmitted
// short by x cot x, x = w sqrt(1 - share) T / 2; dividing by it makes even acceleration exact and
// the error fourth order in T, but for the damper's, which is second. Coulomb friction at the load
// is elastoplastic like the motor's (S of elastoplastic_sign.hpp), solved implicitly: stable, too.
// Range: resonance below half the sample rate, better a quarter.
// Cost: 10 multiplications; with friction at the load 7 more.
// Numerical bound: contraction, states are relative to the motor, nothing grows with travel.
// Together with `backlash` the play lies in series with this spring and `backlash` carries the
// load.
// Bad at: second modes; the observer sees a cutting force through the spring, that is amplified
// near the antiresonance.
#pragma once

#include <cmath>

#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class FlexibleCoupling {
 public:
  static constexpr EffectInfo info = effect_info("flexible-coupling");
  static constexpr EffectTraits traits = {
      .equation = "load behind spring and damper: F = k d + c d'",
      .where = "frequency",
      .signature = "the load swings after each change of acceleration",
      .confused_with = {"current-loop-lag", "transport-delay", "backlash"},
      .splitting_motion = "a chirp through the resonance",
      .sized = true,
      .search = {{{EffectRole::searched, 0.15, 1.3, EffectRange::of_band, 16},
                  {EffectRole::searched, 0.02, 0.3, EffectRange::absolute, 4},
                  {EffectRole::scaled, 0.5, 0.5}}}};

  struct State {
    Real deflection = 0;       // d, short by the bend
    Real deflection_rate = 0;  // d', of the sample behind
    Real motor_velocity = 0;   // mean over the sample behind
    Real load_velocity = 0;
    Real rubbing = 0;  // Coulomb friction at the load
  };

  static Status validate(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    if (!(setting.scalar(0) * drive.sample_period_s < 0.5))
      return Status::invalid("resonance_hz", "must be below half the sample rate");
    return drive.inertia > 0 ? Status{}
                             : Status::invalid("inertia", "must be known for a flexible coupling");
  }
  void configure(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    shares_ = drive.backlash == nullptr ? LoadShares{setting.scalar(2), setting.scalar(3), 0}
                                        : LoadShares{};
    const double mass = shares_.inertia * drive.inertia;
    if (!(mass > 0)) {
      stiffness_ = damping_ = 0;
      load_per_mass_ = {};
      reset();
      return;
    }
    // Load on a held motor: d'' + 2 a d' + w^2 d = F_cut / m2.
    const double held = std::sqrt(1 - shares_.inertia);
    const double w = kTwoPi * setting.scalar(0) * held;
    const double a = setting.scalar(1) * held * w;
    const double T = drive.sample_period_s;
    const double swing = std::sqrt(w * w - a * a);  // share > 0, so never critically damped
    const double decay = std::exp(-a * T);
    const double cosine = decay * std::cos(swing * T);
    const double sine = decay * std::sin(swing * T) / swing;
    dd_ = static_cast<Real>(cosine + a * sine);
    dr_ = static_cast<Real>(sine);
    rd_ = static_cast<Real>(-w * w * sine);
    rr_ = static_cast<Real>(cosine - a * sine);
    const double bend = std::tan(w * T / 2) / (w * T / 2);
    bend_ = static_cast<Real>(bend);
    load_per_mass_ = {static_cast<Real>((1 - cosine - a * sine) / (w * w * mass * bend)),
                      static_cast<Real>(sine / (mass * bend))};
    stiffness_ = static_cast<Real>(bend * mass * w * w);
    damping_ = static_cast<Real>(2 * a * mass);
    viscous_ = static_cast<Real>(shares_.friction * drive.viscous);
    coulomb_ = static_cast<Real>(shares_.friction * drive.coulomb);
    per_second_ = static_cast<Real>(1 / T);
    // Bent by the mean speed of the sample, or by the last where it cannot follow the bristle.
    const double bristle = shares_.friction * drive.coulomb / drive.friction_knee;
    const double angle = std::sqrt(bristle / mass) * T;
    const double last = angle > 2 ? 1 - 1 / angle : 0.5;
    bends_before_ = static_cast<Real>((1 - last) * bristle * T);
    bends_after_ = static_cast<Real>(last * bristle * T);
    yield_ = static_cast<Real>(1 / (1 + last * bristle * T * sine / (mass * bend)));
    reset();
  }
  void reset() noexcept { state_ = State{}; }
  void start(const MotionState<Real>& m) noexcept {
    const Real velocity = m.increment * per_second_;
    const Real rubbing = velocity > 0 ? coulomb_ : velocity < 0 ? -coulomb_ : Real(0);
    state_ = State{0, 0, velocity, velocity, rubbing};
  }
  Real transmitted(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    const Real velocity = m.increment * per_second_;
    const Real before = s.motor_velocity;
    const Real d = s.deflection;
    const Real r = velocity - s.load_velocity;
    const Real pushed = m.cutting + viscous_ * s.load_velocity;
    s.deflection = dd_ * d + dr_ * r + load_per_mass_.deflection * pushed;
    s.deflection_rate = rd_ * d + rr_ * r + load_per_mass_.rate * pushed;
    if (coulomb_ > 0) {
      const Real bent = (s.rubbing + bends_before_ * s.load_velocity +
                         bends_after_ * (velocity - s.deflection_rate)) *
                        yield_;
      s.rubbing = bent > coulomb_ ? coulomb_ : bent < -coulomb_ ? -coulomb_ : bent;
      s.deflection += load_per_mass_.deflection * s.rubbing;
      s.deflection_rate += load_per_mass_.rate * s.rubbing;
    }
    s.load_velocity = velocity - s.deflection_rate;
    s.motor_velocity = velocity;
    // The mean velocity belongs to the middle of the sample; half its change brings it to the end.
    return stiffness_ * s.deflection +
           damping_ * (s.deflection_rate + Real(0.5) * (velocity - before));
  }
  [[nodiscard]] LoadShares load_shares() const noexcept { return shares_; }
  [[nodiscard]] Real deflection() const noexcept { return bend_ * state_.deflection; }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  struct PerForce {
    Real deflection = 0;
    Real rate = 0;
  };

  State state_;
  LoadShares shares_;
  Real dd_ = 1, dr_ = 0, rd_ = 0, rr_ = 1;  // motion of (d, d') over one sample
  PerForce load_per_mass_;                  // and what a force on the load adds
  Real bend_ = 1;
  Real stiffness_ = 0;
  Real damping_ = 0;
  Real viscous_ = 0;  // friction at the load
  Real coulomb_ = 0;
  Real per_second_ = 0;
  Real bends_before_ = 0, bends_after_ = 0;  // friction per speed of the load at both ends
  Real yield_ = 1;                           // and by how much it slows the load in the same sample
};

}  // namespace servosense
