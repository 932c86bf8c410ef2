// Viscous friction beyond the model's own.
//   F = D v
// (Koike 2016, eq. 2-12.)
#pragma once

#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class ViscousFriction {
 public:
  static constexpr EffectInfo info = effect_info("viscous-friction");
  static constexpr EffectTraits traits = {
      .equation = "D v",
      .where = "velocity",
      .signature = "proportional to velocity",
      .confused_with = {"quadratic-drag", "asymmetric-friction"},
      .splitting_motion = "two speeds or more in both directions",
      .search = {{{EffectRole::linear}}}};

  void configure(const EffectSetting& setting, const DriveFacts& /*drive*/) noexcept {
    coefficient_ = static_cast<Real>(setting.scalar(0));
  }
  void reset() noexcept {}
  [[nodiscard]] Real viscous() const noexcept { return coefficient_; }

 private:
  Real coefficient_ = 0;
};

}  // namespace servosense
