// Sum of sines over the turn of a motor or screw, for ripple and cyclic errors.
//   y = sum_i A_i sin(n_i theta + p_i)
// Orders need not be whole: the part of a period that a whole turn leaves over is carried along, so
// there is no jump where the turn angle starts again.
// Delay: none.
// Cost: one sine per order.
// Range: less than half a turn per sample.
// Numerical bound: whole orders have no memory; others err by one rounding per turn.
// Bad at: a broken order's phase after a restart, which begins anew.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/fast_math.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/model/effect.hpp"

namespace servosense {

template <RealNumber Real>
class TurnHarmonics {
 public:
  struct State {
    Real turn_angle_rad = 0;
    bool started = false;
    std::array<Real, kMaxEffectValues> carried{};  // of each order, in periods, [0, 1)
  };

  /// As many amplitudes as orders, and phases too unless there are none.
  static Status validate(const EffectSetting::Values& orders,
                         const EffectSetting::Values& amplitudes,
                         const EffectSetting::Values& phases) noexcept {
    if (amplitudes.count != orders.count)
      return Status::invalid("order", "needs one amplitude for each order");
    if (phases.count != 0 && phases.count != orders.count)
      return Status::invalid("phase_rad", "needs one phase for each order");
    return {};
  }
  void configure(const EffectSetting::Values& orders, const EffectSetting::Values& amplitudes,
                 const EffectSetting::Values& phases) noexcept {
    count_ = orders.count;
    for (std::size_t i = 0; i < count_; ++i) {
      const double phase = i < phases.count ? phases.value[i] / kTwoPi : 0;
      per_rad_[i] = static_cast<Real>(orders.value[i] / kTwoPi);
      per_turn_[i] = static_cast<Real>(fraction(orders.value[i]));
      phase_[i] = static_cast<Real>(fraction(phase));
      amplitude_[i] = static_cast<Real>(amplitudes.value[i]);
    }
    reset();
  }
  void reset() noexcept { state_ = State{}; }

  /// `turn_angle_rad` in [0, 2 pi).
  Real process(Real turn_angle_rad) SERVOSENSE_NONBLOCKING {
    const Real moved = turn_angle_rad - state_.turn_angle_rad;
    const int turn = !state_.started               ? 0
                     : moved < Real(-0.5 * kTwoPi) ? 1
                     : moved > Real(0.5 * kTwoPi)  ? -1
                                                   : 0;
    state_.turn_angle_rad = turn_angle_rad;
    state_.started = true;
    Real sum = 0;
    for (std::size_t i = 0; i < count_; ++i) {
      Real& carried = state_.carried[i];
      carried += static_cast<Real>(turn) * per_turn_[i];
      carried -= carried >= Real(1) ? Real(1) : Real(0);
      carried += carried < Real(0) ? Real(1) : Real(0);
      Real periods = per_rad_[i] * turn_angle_rad + carried + phase_[i];
      periods -= static_cast<Real>(static_cast<std::int32_t>(periods));
      sum += amplitude_[i] * sine_cosine(periods * Real(kTwoPi)).sine;
    }
    return sum;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  static constexpr double fraction(double x) noexcept {
    const double whole = static_cast<double>(static_cast<std::int64_t>(x));
    return x < whole ? x - whole + 1 : x - whole;
  }

  State state_;
  std::size_t count_ = 0;
  std::array<Real, kMaxEffectValues> per_rad_{};
  std::array<Real, kMaxEffectValues> per_turn_{};
  std::array<Real, kMaxEffectValues> phase_{};
  std::array<Real, kMaxEffectValues> amplitude_{};
};

}  // namespace servosense
