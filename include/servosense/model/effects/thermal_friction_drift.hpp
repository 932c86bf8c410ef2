// Friction that settles as the drive warms up.
//   F = dC (1 - exp(-t/tau)) S(x)
// (Koike 2016 measured up to 55 N.)
#pragma once

#include "servosense/model/effect.hpp"
#include "servosense/model/effects/warm_up.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class ThermalFrictionDrift {
 public:
  static constexpr EffectInfo info = effect_info("thermal-friction-drift");
  static constexpr EffectTraits traits = {
      .equation = "dC (1 - exp(-t/tau)) S",
      .where = "time-and-direction",
      .signature = "friction that changes slowly with running time",
      .confused_with = {"position-dependent-friction", "coulomb-friction"},
      .splitting_motion = "the same laps again, from cold and warm",
      .search = {
          {{EffectRole::linear}, {EffectRole::searched, 0.08, 2, EffectRange::of_record, 10}}}};

  void configure(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    change_ = static_cast<Real>(setting.scalar(0));
    warm_.configure(setting.scalar(1), drive.sample_period_s);
  }
  void reset() noexcept { warm_.reset(); }
  void restart() noexcept {}  // a lost sample does not cool the drive
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    return change_ * warm_.advance() * m.direction;
  }
  [[nodiscard]] const typename WarmUp<Real>::State& state() const noexcept { return warm_.state(); }

 private:
  WarmUp<Real> warm_;
  Real change_ = 0;
};

}  // namespace servosense
