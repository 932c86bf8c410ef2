// Friction that differs by direction; the difference is split evenly, so the mean stays where it
// was.
//   F = Da/2 |v| + Ca/2 |S|
// where Da, Ca are forward minus backward coefficients.
#pragma once

#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class AsymmetricFriction {
 public:
  static constexpr EffectInfo info = effect_info("asymmetric-friction");
  static constexpr EffectTraits traits = {.equation = "Da/2 |v| + Ca/2 |S|",
                                          .where = "velocity",
                                          .signature = "even in velocity, growing with speed",
                                          .confused_with = {"constant-load"},
                                          .splitting_motion = "three speeds in both directions",
                                          .search = {{{EffectRole::linear}, {EffectRole::linear}}}};

  void configure(const EffectSetting& setting, const DriveFacts& /*drive*/) noexcept {
    viscous_ = static_cast<Real>(setting.scalar(0) / 2);
    coulomb_ = static_cast<Real>(setting.scalar(1) / 2);
  }
  void reset() noexcept {}
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    const Real speed = m.velocity < 0 ? -m.velocity : m.velocity;
    const Real moving = m.direction < 0 ? -m.direction : m.direction;
    return viscous_ * speed + coulomb_ * moving;
  }

 private:
  Real viscous_ = 0;
  Real coulomb_ = 0;
};

}  // namespace servosense
