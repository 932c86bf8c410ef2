// A torque constant that falls with current: the iron of the motor saturates.
//   u = u_reported                                   |i| <= i_knee
//   u = kt (i_knee + (1 - s) (|i| - i_knee)) sgn i   beyond
// kt the force or torque per ampere of the drive, s the share that is lost. Of an effort that comes
// from a current.
#pragma once

#include "servosense/core/status.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class TorqueSaturation {
 public:
  static constexpr EffectInfo info = effect_info("torque-saturation");
  static constexpr EffectTraits traits = {
      .equation = "u = kt (i_knee + (1 - s) (|i| - i_knee)) sgn i beyond the knee",
      .where = "effort",
      .signature = "beyond a current each ampere moves less than below it",
      .confused_with = {"load-dependent-friction", "quadratic-drag"},
      .splitting_motion = "accelerations small and large, through the same speeds",
      .of_current = true,
      .search = {{{EffectRole::searched, 0.2, 0.9, EffectRange::of_top_current, 12},
                  {EffectRole::linear}}}};

  static Status validate(const EffectSetting& /*setting*/, const DriveFacts& drive) noexcept {
    return drive.effort_per_ampere > 0
               ? Status{}
               : Status::invalid("knee_current_A",
                                 "needs the torque or force constant of the drive");
  }
  void configure(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    knee_ = static_cast<Real>(setting.scalar(0) * drive.effort_per_ampere);
    lost_ = static_cast<Real>(setting.scalar(1));
  }
  void reset() noexcept {}
  Real acting_effort(Real reported, const MotionState<Real>& /*m*/) SERVOSENSE_NONBLOCKING {
    if (reported > knee_) return reported - lost_ * (reported - knee_);
    if (reported < -knee_) return reported - lost_ * (reported + knee_);
    return reported;
  }

 private:
  Real knee_ = 0;
  Real lost_ = 0;
};

}  // namespace servosense
