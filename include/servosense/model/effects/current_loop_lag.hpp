// The effort follows its reference through a current loop of finite bandwidth.
//   du/dt = w (u_reported - u),   w = 2 pi bandwidth
// Discretisation: exact for an effort that is linear between samples, so that a low bandwidth and a
// slow sample rate cost no accuracy.
#pragma once

#include <cmath>

#include "servosense/core/units.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class CurrentLoopLag {
 public:
  static constexpr EffectInfo info = effect_info("current-loop-lag");
  static constexpr EffectTraits traits = {
      .equation = "du/dt = 2 pi f (u_reported - u)",
      .where = "force-rate",
      .signature = "the effort follows its reference late and rounded",
      .confused_with = {"transport-delay"},
      .splitting_motion =
          "fast changes of force: the phase of a delay is linear in frequency, a lag rolls off",
      .sized = true,
      .search = {{{EffectRole::searched, 15, 600, EffectRange::absolute, 14}}}};

  struct State {
    Real reported = 0;
    Real acting = 0;
  };

  void configure(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    const double wT = kTwoPi * setting.scalar(0) * drive.sample_period_s;
    const double moved = -std::expm1(-wT);  // by a step at the start of the sample
    const double ramp = wT > 1e-6 ? 1 - moved / wT : wT / 2;  // by a ramp to one
    newest_ = static_cast<Real>(ramp);
    last_ = static_cast<Real>(moved - ramp);
  }
  void reset() noexcept { state_ = State{}; }
  void start(const MotionState<Real>& m) noexcept { state_ = State{m.effort, m.effort}; }
  Real acting_effort(Real reported, const MotionState<Real>& /*m*/) SERVOSENSE_NONBLOCKING {
    const Real y = state_.acting;
    state_.acting = y + newest_ * (reported - y) + last_ * (state_.reported - y);
    state_.reported = reported;
    return state_.acting;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  Real newest_ = 0;
  Real last_ = 0;
};

}  // namespace servosense
