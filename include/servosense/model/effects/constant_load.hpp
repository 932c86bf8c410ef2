// A constant load: gravity beyond the model's, an unbalanced counterweight, an offset of the drive.
//   F = F0
#pragma once

#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class ConstantLoad {
 public:
  static constexpr EffectInfo info = effect_info("constant-load");
  static constexpr EffectTraits traits = {
      .equation = "F0",
      .where = "velocity",
      .signature = "the same force in both directions",
      .confused_with = {"asymmetric-friction", "spring-load"},
      .splitting_motion = "standstill with the brake open, or the axis mounted the other way round",
      .search = {{{EffectRole::linear}}}};

  void configure(const EffectSetting& setting, const DriveFacts& /*drive*/) noexcept {
    force_ = static_cast<Real>(setting.scalar(0));
  }
  void reset() noexcept {}
  Real force(const MotionState<Real>&) SERVOSENSE_NONBLOCKING { return force_; }

 private:
  Real force_ = 0;
};

}  // namespace servosense
