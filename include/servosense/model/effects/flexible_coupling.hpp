// Two masses: the load hangs on the motor by a spring and a damper.
//   d = x - x_load,  F = k d + c d',  m2 x_load'' = F - F_cut,  m2 = share * J,  m1 = J - m2
//   k = m1 m2 / J * w^2,   c = m1 m2 / J * 2 zeta w
// w = 2 pi resonance_hz is the resonance of the free pair and zeta its damping ratio; with the
// motor held, the load swings at the antiresonance w sqrt(1 - share) (Koike 2016, eq. 2-12 to 2-14,
// with friction kept at the motor).
// Discretisation: exact for a motor that moves steadily between samples, hence stable at any
// resonance. A motor that accelerates evenly bends away from that chord and would be transmitted
// short by x cot x, x = w sqrt(1 - share) T / 2; dividing by it makes even acceleration exact and
// the error fourth order in T, but for the damper's, which is second.
// Range: resonance below half the sample rate, better a quarter.
// Cost: 10 multiplications.
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
  static constexpr EffectInfo info = {
      "flexible-coupling",
      {{{.key = "resonance_hz", .low = 1e-2, .high = 1e5},
        {.key = "damping_ratio", .low = 0, .high = 1},
        {.key = "mass_share", .low = 0.001, .high = 0.999, .turning_key = "inertia_share"}}}};
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
  };

  static Status validate(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    if (!(setting.scalar(0) * drive.sample_period_s < 0.5))
      return Status::invalid("resonance_hz", "must be below half the sample rate");
    return drive.inertia > 0 ? Status{}
                             : Status::invalid("inertia", "must be known for a flexible coupling");
  }
  void configure(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    shares_ = drive.backlash == nullptr ? LoadShares{setting.scalar(2), 0, 0} : LoadShares{};
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
    per_second_ = static_cast<Real>(1 / T);
    reset();
  }
  void reset() noexcept { state_ = State{}; }
  void start(const MotionState<Real>& m) noexcept {
    const Real velocity = m.increment * per_second_;
    state_ = State{0, 0, velocity, velocity};
  }
  Real transmitted(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    const Real velocity = m.increment * per_second_;
    const Real before = s.motor_velocity;
    const Real d = s.deflection;
    const Real r = velocity - s.load_velocity;
    s.deflection = dd_ * d + dr_ * r + load_per_mass_.deflection * m.cutting;
    s.deflection_rate = rd_ * d + rr_ * r + load_per_mass_.rate * m.cutting;
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
  Real per_second_ = 0;
};

}  // namespace servosense
