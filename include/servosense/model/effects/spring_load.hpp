// A spring against the stage: cable chain, bellows, gas spring.
//   F = k (x - x0)
// x0 counts from where the record starts.
#pragma once

#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class SpringLoad {
 public:
  static constexpr EffectInfo info = effect_info("spring-load");
  static constexpr EffectTraits traits = {
      .equation = "k (x - x0)",
      .where = "position",
      .signature = "a force that follows position, the same in both directions",
      .confused_with = {"constant-load", "position-dependent-friction"},
      .splitting_motion = "the whole stroke at constant speed, both ways",
      .search = {{{EffectRole::linear}, {EffectRole::offset}}}};

  void configure(const EffectSetting& setting, const DriveFacts& /*drive*/) noexcept {
    stiffness_ = static_cast<Real>(setting.scalar(0));
    rest_ = static_cast<Real>(setting.scalar(1));
  }
  void reset() noexcept {}
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    return stiffness_ * (m.position - rest_);
  }

 private:
  Real stiffness_ = 0;
  Real rest_ = 0;
};

}  // namespace servosense
