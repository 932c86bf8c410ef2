// Force from an accelerometer by integration: the "analog computer" of one vibration mode.
//
// Purpose: the force on a spindle or table that swings in one mode, from its acceleration.
// Equation: F = m (a + 2 z w v + w^2 x) with v and x by leaky integration of a, a/(s+g) and
// a/(s+g)^2 (Tarng 1988, eq. 5-5 to 5-7). The leak turns the mode's own phase; taken out of it,
//   F_est = m (a + (2 z w - 2 g) v + (w^2 - 2 g z w + g^2) x),   F_est / F = s^2 / (s + g)^2
// exactly where there is one mode.
// Discretisation: Tustin, true at the natural frequency, where the three terms nearly cancel.
// Delay: none above the leak; below, the phase of the high-pass leads.
// Cost on Cortex-M4F: 41 instructions.
// Range: leak below half the natural frequency, that below a quarter of the sample rate.
// Numerical bound: contraction; in float 2u (w/g)^2 of the largest acceleration, u = 6e-8.
// Bad at: the mean and all below the leak, which are lost; a mode that is off (by 2 d / (2 z) of
// the force at the mode itself, d its relative frequency error); a second mode, of which nothing
// is known here. Figures: docs/acceleration-force.md.
#pragma once

#include <cmath>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

struct AccelerationForceConfig {
  double sample_period_s = 1 / 25600.;
  double natural_frequency_hz = 0;
  double damping_ratio = 0;
  double modal_mass_kg = 0;
  double leak_hz = 2;  ///< g / 2 pi: below it the force is lost
};

template <RealNumber Real>
class AccelerationForce {
 public:
  using Config = AccelerationForceConfig;
  struct State {
    Real acceleration = 0;  // [m/s2]
    Real velocity = 0;      // [m/s], above the leak
    Real displacement = 0;  // [m], likewise
    Real estimate = 0;      // force [N]
    Quality quality = Quality::settling;
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0 && c.sample_period_s < 1))
      return Status::invalid("sample_period_s", "must be within 0 and 1 s");
    if (!(c.natural_frequency_hz > 0 && c.natural_frequency_hz * c.sample_period_s < 0.25))
      return Status::invalid("natural_frequency_hz",
                             "must be above 0 and below a quarter of the sample rate");
    if (!(c.damping_ratio > 0 && c.damping_ratio < 1))
      return Status::invalid("damping_ratio", "must be within 0 and 1");
    if (!(c.modal_mass_kg > 0 && c.modal_mass_kg < 1e9))
      return Status::invalid("modal_mass_kg", "must be positive");
    if (!(c.leak_hz > 0 && c.leak_hz < c.natural_frequency_hz / 2))
      return Status::invalid("leak_hz", "must be above 0 and below half the natural frequency");
    return {};
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    const double w = kTwoPi * c.natural_frequency_hz;
    const double g = kTwoPi * c.leak_hz;
    const double tustin = w / std::tan(w * c.sample_period_s / 2);
    keep_ = static_cast<Real>((tustin - g) / (tustin + g));
    step_ = static_cast<Real>(1 / (tustin + g));
    mass_ = static_cast<Real>(c.modal_mass_kg);
    damping_ = static_cast<Real>(c.modal_mass_kg * 2 * (c.damping_ratio * w - g));
    stiffness_ = static_cast<Real>(c.modal_mass_kg * (w * w - 2 * g * c.damping_ratio * w + g * g));
    settling_ = static_cast<Real>(5 / (g * c.sample_period_s));
    reset();
  }
  void reset() noexcept {
    state_ = State{};
    samples_ = 0;
  }

  /// Returns the force [N] behind the acceleration [m/s2]. An unusable sample repeats the one
  /// before.
  Real process(Real acceleration, Quality quality = Quality::good) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.quality = quality;
    if (!is_moderate(acceleration) || has(quality, kUnusable)) {
      s.quality |= is_moderate(acceleration) ? Quality::good : Quality::invalid;
      acceleration = s.acceleration;
    }
    if (has(quality, Quality::gap | Quality::restarted)) {
      s.velocity = s.displacement = 0;
      s.acceleration = acceleration;
      samples_ = 0;
    }
    if (samples_ < settling_) {
      samples_ += Real(1);
      s.quality |= Quality::settling;
    }
    const Real velocity = keep_ * s.velocity + step_ * (acceleration + s.acceleration);
    s.displacement = keep_ * s.displacement + step_ * (velocity + s.velocity);
    s.velocity = velocity;
    s.acceleration = acceleration;
    return s.estimate = mass_ * acceleration + damping_ * velocity + stiffness_ * s.displacement;
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  Real keep_ = 0, step_ = 0;
  Real mass_ = 0, damping_ = 0, stiffness_ = 0;
  Real settling_ = 0, samples_ = 0;
};

}  // namespace servosense
