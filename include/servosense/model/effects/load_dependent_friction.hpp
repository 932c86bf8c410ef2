// Friction that grows with the force the screw passes on.
//   F = mu |u| S(x)
// u the effort that acts: force of inertia, cutting and friction together, so that 1 - mu is the
// efficiency of the screw.
#pragma once

#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class LoadDependentFriction {
 public:
  static constexpr EffectInfo info = effect_info("load-dependent-friction");
  static constexpr EffectTraits traits = {
      .equation = "mu |u| S",
      .where = "transmitted-force",
      .signature = "friction that grows with the force transmitted",
      .confused_with = {"coulomb-friction", "asymmetric-friction"},
      .splitting_motion = "the same speed at several accelerations",
      .search = {{{EffectRole::linear}}}};

  void configure(const EffectSetting& setting, const DriveFacts& /*drive*/) noexcept {
    coefficient_ = static_cast<Real>(setting.scalar(0));
  }
  void reset() noexcept {}
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    return coefficient_ * (m.effort < 0 ? -m.effort : m.effort) * m.direction;
  }

 private:
  Real coefficient_ = 0;
};

}  // namespace servosense
