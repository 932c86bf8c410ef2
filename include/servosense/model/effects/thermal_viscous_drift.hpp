// Viscous friction that settles as the drive warms up: cold grease, spindle bearings.
//   F = dD (1 - exp(-t/tau)) v
#pragma once

#include "servosense/model/effect.hpp"
#include "servosense/model/effects/warm_up.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class ThermalViscousDrift {
 public:
  static constexpr EffectInfo info = effect_info("thermal-viscous-drift");
  static constexpr EffectTraits traits = {
      .equation = "dD (1 - exp(-t/tau)) v",
      .where = "time-and-velocity",
      .signature = "friction in proportion to speed that changes slowly with running time",
      .confused_with = {"thermal-friction-drift", "viscous-friction"},
      .splitting_motion = "the same speeds again, from cold and warm",
      .search = {
          {{EffectRole::linear}, {EffectRole::searched, 0.08, 2, EffectRange::of_record, 10}}}};

  void configure(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    change_ = static_cast<Real>(setting.scalar(0));
    warm_.configure(setting.scalar(1), drive.sample_period_s);
  }
  void reset() noexcept { warm_.reset(); }
  void restart() noexcept {}  // a lost sample does not cool the drive
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    return change_ * warm_.advance() * m.velocity;
  }

 private:
  WarmUp<Real> warm_;
  Real change_ = 0;
};

}  // namespace servosense
