// The drive: what the motor must overcome when nothing is cut.
//
// Purpose: one description of a spindle or a feed axis that observer, simulator and identification
// share (Koike 2016, eq. 2-10 and 2-18, in units of the stage for an axis):
//   effort = J a + D v + C S(x) + L + sum of effects + cutting
// with inertia J, viscous friction D, Coulomb friction C on the elastoplastic sign S, constant load
// L (gravity of a vertical axis) and the effects switched on in the machine file. Units: kg, N, m
// for an axis; kg m2, Nm, rad for a spindle.
#pragma once

#include "servosense/core/drive_sample.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/model/drive_effects.hpp"
#include "servosense/model/elastoplastic_sign.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

struct DriveModelConfig {
  double inertia = 0;           ///< kg or kg m2
  double viscous = 0;           ///< N s/m or Nm s/rad
  double coulomb = 0;           ///< N or Nm
  double constant_load = 0;     ///< N or Nm the motor carries at rest: m g for a vertical axis
  double friction_knee = 5e-6;  ///< m or rad of travel over which Coulomb friction reverses, halved
  DriveEffectsConfig effects;
};

template <RealNumber Real>
class DriveModel {
 public:
  using Config = DriveModelConfig;

  static Status validate(const Config& c) noexcept {
    if (!(c.inertia >= 0)) return Status::invalid("inertia", "must not be negative");
    if (!(c.viscous >= 0)) return Status::invalid("viscous", "must not be negative");
    if (!(c.coulomb >= 0)) return Status::invalid("coulomb", "must not be negative");
    if (!is_finite(c.constant_load)) return Status::invalid("constant_load", "must be finite");
    if (const Status s = ElastoplasticSign<Real>::validate(c.friction_knee); !s.ok())
      return Status::invalid("friction_knee", s.reason());
    return DriveEffects<Real>::validate(c.effects);
  }
  void configure(const Config& c) noexcept {
    inertia_ = static_cast<Real>(c.inertia);
    viscous_ = static_cast<Real>(c.viscous);
    coulomb_ = static_cast<Real>(c.coulomb);
    load_ = static_cast<Real>(c.constant_load);
    sign_.configure(c.friction_knee);
    effects_.configure(c.effects);
  }
  void reset() noexcept {
    sign_.reset();
    effects_.reset();
  }

  [[nodiscard]] Real inertia() const noexcept { return inertia_; }
  [[nodiscard]] Real viscous() const noexcept { return viscous_; }

  /// Everything but inertia and viscous friction, which callers take from their own derivative of
  /// the motion. Fills `m.direction`. Call once per sample.
  Real resistance(MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    m.direction = sign_.process(m.increment);
    return coulomb_ * m.direction + load_ + effects_.force(m);
  }

 private:
  Real inertia_ = 0;
  Real viscous_ = 0;
  Real coulomb_ = 0;
  Real load_ = 0;
  ElastoplasticSign<Real> sign_;
  DriveEffects<Real> effects_;
};

}  // namespace servosense
