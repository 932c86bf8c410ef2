// Drag that grows with the square of speed (windage); negative when friction grows less than
// linearly.
//   F = Q v |v|
#pragma once

#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class QuadraticDrag {
 public:
  static constexpr EffectInfo info = effect_info("quadratic-drag");
  static constexpr EffectTraits traits = {
      .equation = "Q v |v|",
      .where = "velocity",
      .signature = "odd in velocity, curved at high speed",
      .confused_with = {"viscous-friction", "stribeck-friction"},
      .splitting_motion = "three speeds in the upper half of the range",
      .search = {{{EffectRole::linear}}}};

  void configure(const EffectSetting& setting, const DriveFacts& /*drive*/) noexcept {
    coefficient_ = static_cast<Real>(setting.scalar(0));
  }
  void reset() noexcept {}
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    return coefficient_ * m.velocity * (m.velocity < 0 ? -m.velocity : m.velocity);
  }

 private:
  Real coefficient_ = 0;
};

}  // namespace servosense
