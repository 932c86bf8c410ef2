// Coulomb friction beyond the model's own.
//   F = C S(x)
// with the sign of motion S of model/elastoplastic_sign.hpp (Koike 2016, eq. 2-12).
#pragma once

#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class CoulombFriction {
 public:
  static constexpr EffectInfo info = effect_info("coulomb-friction");
  static constexpr EffectTraits traits = {
      .equation = "C S",
      .where = "velocity",
      .signature = "changes sign with the direction, whatever the speed",
      .confused_with = {"stribeck-friction", "presliding-hysteresis"},
      .splitting_motion = "two speeds or more in both directions",
      .search = {{{EffectRole::linear}}}};

  void configure(const EffectSetting& setting, const DriveFacts& /*drive*/) noexcept {
    force_ = static_cast<Real>(setting.scalar(0));
  }
  void reset() noexcept {}
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING { return force_ * m.direction; }

 private:
  Real force_ = 0;
};

}  // namespace servosense
