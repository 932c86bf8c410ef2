// Presliding hysteresis: friction that swings over slowly after a reversal.
//   F = F_D - F_b S(x),   dF_D/dx = s (1 - F_D/F_b sgn dx)
// the bristle of Dahl 1968 (exponent 1; the rate-independent part of Canudas de Wit 1995, eq. 3)
// with stiffness s and breakaway F_b, less the same force with the model's short knee. F_b of the
// model's Coulomb friction C is thus given the longer reversal: sliding friction stays C, and F_b =
// C replaces the knee altogether.
// Discretisation: exact for any step (an exponential in the travel), so it depends on the path
// alone, neither on speed nor on the sample rate.
#pragma once

#include "servosense/core/fast_math.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class PreslidingHysteresis {
 public:
  static constexpr EffectInfo info = effect_info("presliding-hysteresis");
  static constexpr EffectTraits traits = {
      .equation = "Fd - Fb S, dFd/dx = s (1 - Fd/Fb sgn dx)",
      .where = "travel-since-reversal",
      .signature = "friction that builds up over a length of travel after each reversal",
      .confused_with = {"backlash", "stribeck-friction"},
      .splitting_motion = "twenty slow reversals of 0.2 mm and of 2 mm",
      .search = {
          {{EffectRole::scaled, 0.01, 0.33, EffectRange::per_knee, 14}, {EffectRole::linear}}}};

  struct State {
    Real bristle = 0;  // F_D / F_b, -1..1
  };

  void configure(const EffectSetting& setting, const DriveFacts& /*drive*/) noexcept {
    breakaway_ = static_cast<Real>(setting.scalar(1));
    per_travel_ = static_cast<Real>(setting.scalar(0) / setting.scalar(1));
  }
  void reset() noexcept { state_ = State{}; }
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    const Real end = m.increment < 0 ? Real(-1) : Real(1);
    const Real travel = m.increment * end * per_travel_;
    state_.bristle = end + (state_.bristle - end) * exp_negative(travel);
    return breakaway_ * (state_.bristle - m.direction);
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  Real breakaway_ = 0;
  Real per_travel_ = 0;
};

}  // namespace servosense
