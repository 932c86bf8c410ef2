// The drive: what the motor must overcome when nothing is cut.
//
// Purpose: one description of a spindle or a feed axis that observer, simulator and identification
// share (Koike 2016, eq. 2-10 and 2-18, in units of the stage for an axis):
//   effort = J a + D v + C S(x) + L + sum of effects + cutting
// with inertia J, viscous friction D, Coulomb friction C on the elastoplastic sign S, constant load
// L (gravity of a vertical axis) and the effects switched on in the machine file. Units: kg, N, m
// for an axis; kg m2, Nm, rad for a spindle. Behind play or a spring (backlash, flexible-coupling)
// the load takes its share of these terms along, and what it draws from the motor is among the
// effects: inertia() and viscous() are then those of the motor side.
#pragma once

#include "servosense/core/drive_sample.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/model/drive_effects.hpp"
#include "servosense/model/elastoplastic_sign.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

/// `Effects`: DriveEffectsConfig, or DriveEffectsView where memory counts.
template <typename Effects>
struct DriveModelConfigWith {
  double inertia = 0;           ///< kg or kg m2
  double viscous = 0;           ///< N s/m or Nm s/rad
  double coulomb = 0;           ///< N or Nm
  double constant_load = 0;     ///< N or Nm the motor carries at rest: m g for a vertical axis
  double friction_knee = 5e-6;  ///< m or rad of travel over which Coulomb friction reverses, halved
  Effects effects;
  double unit_per_turn = 0;         ///< m or rad per turn of the encoder; 0: not known
  double load_inertia_share = 0.5;  ///< of the stage in the inertia; matters behind play
  double load_friction_share = 0.5;
  double effort_per_ampere = 0;  ///< N/A or Nm/A; 0: not known

  /// The same drive with other `effects`.
  template <typename Other>
  [[nodiscard]] constexpr DriveModelConfigWith<Other> with(const Other& other) const noexcept {
    return {inertia,
            viscous,
            coulomb,
            constant_load,
            friction_knee,
            other,
            unit_per_turn,
            load_inertia_share,
            load_friction_share,
            effort_per_ampere};
  }
};
using DriveModelConfig = DriveModelConfigWith<DriveEffectsConfig>;
using DriveModelView = DriveModelConfigWith<DriveEffectsView>;

/// `c` with its effects left where they are: `c` must outlive the use of what is returned.
[[nodiscard]] constexpr DriveModelView view_of(const DriveModelConfig& c) noexcept {
  return c.with(DriveEffectsView(c.effects));
}

template <RealNumber Real>
class DriveModel {
 public:
  using Config = DriveModelConfig;

  static Status validate(const Config& c) noexcept { return validate(view_of(c)); }
  static Status validate(const DriveModelView& c) noexcept {
    if (!(c.inertia >= 0)) return Status::invalid("inertia", "must not be negative");
    if (!(c.viscous >= 0)) return Status::invalid("viscous", "must not be negative");
    if (!(c.coulomb >= 0)) return Status::invalid("coulomb", "must not be negative");
    if (!is_finite(c.constant_load)) return Status::invalid("constant_load", "must be finite");
    if (const Status s = ElastoplasticSign<Real>::validate(c.friction_knee); !s.ok())
      return Status::invalid("friction_knee", s.reason());
    if (!(c.unit_per_turn >= 0)) return Status::invalid("unit_per_turn", "must not be negative");
    if (!(c.load_inertia_share >= 0.01 && c.load_inertia_share <= 0.99))
      return Status::invalid("load_inertia_share", "must be within 0.01 and 0.99");
    if (!(c.load_friction_share >= 0 && c.load_friction_share <= 1))
      return Status::invalid("load_friction_share", "must be within 0 and 1");
    return DriveEffects<Real>::validate(c.effects, facts_of(c));
  }
  void configure(const Config& c) noexcept { configure(view_of(c)); }
  void configure(const DriveModelView& c) noexcept {
    effects_.configure(c.effects, facts_of(c));
    plain_ = !effects_.any();
    const LoadShares load = effects_.load_shares();
    has_load_ = load.inertia > 0;
    inertia_ = static_cast<Real>(c.inertia * (1 - load.inertia));
    viscous_ = static_cast<Real>(c.viscous * (1 - load.friction)) + effects_.viscous();
    coulomb_ = static_cast<Real>(c.coulomb * (1 - load.friction));
    load_ = static_cast<Real>(c.constant_load * (1 - load.constant_load));
    sign_.configure(c.friction_knee);
    reset();
  }
  /// At rest.
  void reset() noexcept {
    sign_.reset();
    effects_.reset();
    last_error_ = 0;
  }
  /// After a gap, at the motion `m`: forgets everything but the running time.
  void restart(const MotionState<Real>& m) noexcept {
    sign_.reset();
    effects_.restart();
    last_error_ = effects_.position_error(m);
  }
  /// Hidden motion and effort begin as if it had always been like `m`.
  void start(const MotionState<Real>& m) noexcept { effects_.start(m); }

  [[nodiscard]] Real inertia() const noexcept { return inertia_; }
  [[nodiscard]] Real viscous() const noexcept { return viscous_; }
  /// Friction that has changed since configure(), of the motor side; what effects add goes on top.
  void set_friction(Real viscous, Real coulomb) noexcept {
    viscous_ = viscous + effects_.viscous();
    coulomb_ = coulomb;
  }
  /// True when the load moves apart from the motor, and `m.cutting` acts on it there.
  [[nodiscard]] bool has_load() const noexcept { return has_load_; }
  /// Motor minus load position.
  [[nodiscard]] Real deflection() const noexcept { return effects_.deflection(); }

  /// Everything but inertia and viscous friction, which callers take from their own derivative of
  /// the motion. Fills `m.direction`. Call once per sample.
  Real resistance(MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    const Real plain = plain_resistance(m.increment);
    m.direction = sign_.state().deflection;
    return plain_ ? plain : plain + effects_.force(m);
  }
  /// True when no effect is switched on: resistance is then plain_resistance().
  [[nodiscard]] bool plain() const noexcept { return plain_; }
  /// resistance() of a model without effects.
  Real plain_resistance(Real increment) SERVOSENSE_NONBLOCKING {
    return coulomb_ * sign_.process(increment) + load_;
  }
  /// Effort that acts, given the effort that is reported and all else of `m`. Call once per
  /// sample.
  Real acting_effort(Real reported, const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    return plain_ ? reported : effects_.acting_effort(reported, m);
  }
  /// Measured minus true position, at the true (or, nearly the same, the measured) motion.
  Real position_error(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    return effects_.position_error(m);
  }
  /// Turns measured motion into true motion: position and increment. Call once per sample.
  void correct(MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    if (plain_) return;
    const Real error = effects_.position_error(m);
    m.increment -= error - last_error_;
    m.position -= error;
    last_error_ = error;
  }

 private:
  static DriveFacts facts_of(const DriveModelView& c) noexcept {
    DriveFacts f;
    f.inertia = c.inertia;
    f.viscous = c.viscous;
    f.coulomb = c.coulomb;
    f.constant_load = c.constant_load;
    f.friction_knee = c.friction_knee;
    f.unit_per_turn = c.unit_per_turn;
    f.load_inertia_share = c.load_inertia_share;
    f.load_friction_share = c.load_friction_share;
    f.effort_per_ampere = c.effort_per_ampere;
    return f;
  }

  Real inertia_ = 0;
  Real viscous_ = 0;
  Real coulomb_ = 0;
  Real load_ = 0;
  Real last_error_ = 0;
  bool has_load_ = false;
  bool plain_ = true;
  ElastoplasticSign<Real> sign_;
  DriveEffects<Real> effects_;  // large, so last: what every sample needs stays in reach
};

}  // namespace servosense
