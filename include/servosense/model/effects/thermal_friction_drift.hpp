// Friction that settles as the drive warms up.
//   F = dC (1 - exp(-t/tau)) S(x)
// t the running time since the start, through gaps in the data too (first-order heating; Koike 2016
// measured up to 55 N).
// Discretisation: the clock ticks once a sample, the exponential moves once in tau/1000, exactly:
// steps of 0.1 % of dC, and no rounding however long tau is.
#pragma once

#include <cmath>
#include <cstdint>

#include "servosense/core/whole.hpp"
#include "servosense/model/effect.hpp"
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

  struct State {
    Real cold = 1;  // exp(-t/tau)
    std::uint32_t samples = 0;
  };

  void configure(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    change_ = static_cast<Real>(setting.scalar(0));
    const std::uint32_t samples = whole(1e-3 * setting.scalar(1) / drive.sample_period_s);
    stride_ = samples < 1 ? 1U : samples;
    decay_ = static_cast<Real>(
        std::exp(-static_cast<double>(stride_) * drive.sample_period_s / setting.scalar(1)));
  }
  void reset() noexcept { state_ = State{}; }
  void restart() noexcept {}  // a lost sample does not cool the drive
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    if (++state_.samples >= stride_) {
      state_.samples = 0;
      state_.cold *= decay_;
    }
    return change_ * (Real(1) - state_.cold) * m.direction;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  Real change_ = 0;
  Real decay_ = 1;
  std::uint32_t stride_ = 1;
};

}  // namespace servosense
