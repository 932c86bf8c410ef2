// Stribeck friction: friction that falls as lubrication builds up.
//   F = Fs exp(-(v/vs)^2) S(x)
#pragma once

#include "servosense/core/fast_math.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class StribeckFriction {
 public:
  static constexpr EffectInfo info = effect_info("stribeck-friction");
  static constexpr EffectTraits traits = {
      .equation = "Fs exp(-(v/vs)^2) S",
      .where = "velocity",
      .signature = "more friction at low speed only, odd in velocity",
      .confused_with = {"coulomb-friction", "presliding-hysteresis"},
      .splitting_motion = "constant slow speeds down to a third of the Stribeck velocity",
      .search = {{{EffectRole::linear},
                  {EffectRole::searched, 0.01, 0.5, EffectRange::of_top_speed, 14}}}};

  void configure(const EffectSetting& setting, const DriveFacts& /*drive*/) noexcept {
    amplitude_ = static_cast<Real>(setting.scalar(0));
    per_velocity_ = static_cast<Real>(1 / setting.scalar(1));
  }
  void reset() noexcept {}
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    const Real ratio = m.velocity * per_velocity_;
    return amplitude_ * exp_negative(ratio * ratio) * m.direction;
  }

 private:
  Real amplitude_ = 0;
  Real per_velocity_ = 0;
};

}  // namespace servosense
