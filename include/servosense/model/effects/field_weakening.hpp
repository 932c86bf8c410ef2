// A torque constant that falls with speed: beyond base speed the voltage is used up, and the field
// is weakened so that the motor turns faster.
//   u = u_reported                      |v| <= v_base
//   u = u_reported (v_base / |v|)^n     beyond; n = 1: constant power
// or u = u_reported / c(|v|), c the current per torque in units of that at low speed, linear
// between the pairs of a table (which constant power is, too), and beyond the last. Of an effort
// that comes from a current. Discretisation: the speed is smoothed over 2 ms by a fading memory of
// first degree (Morrison 1969), which does not lag while the drive accelerates: a lag would look
// like friction. n in steps of 1/1024, by square roots.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/status.hpp"
#include "servosense/core/whole.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class FieldWeakening {
 public:
  static constexpr EffectInfo info = effect_info("field-weakening");
  static constexpr EffectTraits traits = {
      .equation = "u = u_reported (v_base / |v|)^n beyond base speed",
      .where = "velocity-and-effort",
      .signature = "beyond a speed every acceleration takes more current than below it",
      .confused_with = {"quadratic-drag", "viscous-friction"},
      .splitting_motion = "run-ups and run-downs through the whole range of speeds",
      .of_current = true,
      .sized = true,
      .search = {{{EffectRole::searched, 0.15, 0.95, EffectRange::of_top_speed, 14}}}};

  struct State {
    Real speed = 0;
    Real change = 0;  // of the speed, in a sample
    bool primed = false;
  };

  static Status validate(const EffectSetting& setting) noexcept {
    const EffectSetting::Values& table = setting.parameters[2];
    const bool law = setting.parameters[0].count > 0;
    if (law == (table.count > 0))
      return Status::invalid(info.parameters[0].turning_key,
                             "or a table is needed, and not both of them");
    if (law) return {};
    const char* key = info.parameters[2].turning_key;
    if (table.count % 2 != 0 || table.count < 4)
      return Status::invalid(key, "needs at least two pairs of speed and ratio");
    if (table.value[1] != 1) return Status::invalid(key, "must begin with the ratio 1");
    for (std::size_t i = 2; i < table.count; i += 2) {
      if (!(table.value[i] > table.value[i - 2]))
        return Status::invalid(key, "needs speeds that rise");
      if (!(table.value[i + 1] > 0)) return Status::invalid(key, "needs ratios above zero");
    }
    return {};
  }
  void configure(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    const double fades = std::exp(-drive.sample_period_s / kMemory_s);
    of_speed_ = static_cast<Real>(1 - fades * fades);
    of_change_ = static_cast<Real>((1 - fades) * (1 - fades));
    rate_ = static_cast<Real>(1 / drive.sample_period_s);
    const EffectSetting::Values& table = setting.parameters[2];
    knots_ = table.count / 2;
    for (std::size_t k = 0; k < knots_; ++k) {
      speed_[k] = static_cast<Real>(table.value[2 * k]);
      ratio_[k] = static_cast<Real>(table.value[2 * k + 1]);
    }
    base_ = knots_ > 0 ? speed_[0] : static_cast<Real>(setting.scalar(0));
    const double exponent = setting.parameters[1].count > 0 ? setting.scalar(1) : 1.0;
    exponent_ = whole(exponent * kSteps + 0.5);
  }
  void reset() noexcept { state_ = State{}; }
  Real acting_effort(Real reported, const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    const Real measured = m.increment * rate_;
    if (!s.primed) s = {measured, 0, true};
    const Real off = measured - s.speed - s.change;
    s.speed += s.change + of_speed_ * off;
    s.change += of_change_ * off;
    const Real speed = s.speed < 0 ? -s.speed : s.speed;
    if (!(speed > base_)) return reported;
    return knots_ > 0 ? reported / current_per_torque(speed) : reported * power(base_ / speed);
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  static constexpr double kMemory_s = 2e-3;
  static constexpr std::uint32_t kSteps = 1024;
  [[nodiscard]] Real power(Real ratio) const noexcept {
    Real product = 1;
    for (std::uint32_t whole = exponent_ / kSteps; whole > 0; --whole) product *= ratio;
    Real root = ratio;
    for (std::uint32_t rest = exponent_ % kSteps, bit = kSteps / 2; rest != 0; bit /= 2) {
      root = std::sqrt(root);
      if (rest < bit) continue;
      product *= root;
      rest -= bit;
    }
    return product;
  }
  [[nodiscard]] Real current_per_torque(Real speed) const noexcept {
    std::size_t k = 1;
    while (k + 1 < knots_ && speed > speed_[k]) ++k;
    const Real share = (speed - speed_[k - 1]) / (speed_[k] - speed_[k - 1]);
    const Real ratio = ratio_[k - 1] + share * (ratio_[k] - ratio_[k - 1]);
    return ratio > kLeastRatio ? ratio : kLeastRatio;
  }
  static constexpr Real kLeastRatio = Real(0.01);  // however a table goes on beyond its end

  State state_;
  Real of_speed_ = 1, of_change_ = 0;
  Real rate_ = 1;
  Real base_ = 1;
  std::uint32_t exponent_ = kSteps;  // in 1/1024
  std::size_t knots_ = 0;
  std::array<Real, kMaxEffectValues / 2> speed_{}, ratio_{};
};

}  // namespace servosense
