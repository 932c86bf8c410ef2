// Friction that varies along the stroke: a slope, or a tight spot.
//   F = c(x) S(x)
// c linear between knots, constant beyond them. `profile` holds up to eight knots: position,
// friction, position, friction, ... in ascending order; positions count from where the record
// starts. Beside the model's Coulomb friction: c may be negative.
#pragma once

#include <array>
#include <cstddef>

#include "servosense/core/status.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class PositionDependentFriction {
 public:
  static constexpr EffectInfo info = effect_info("position-dependent-friction");
  static constexpr EffectTraits traits = {
      .equation = "c(x) S",
      .where = "position-and-direction",
      .signature = "direction-dependent force whose size varies along the stroke",
      .confused_with = {"thermal-friction-drift", "spring-load"},
      .splitting_motion = "the whole stroke at constant speed, both ways",
      .search = {{{EffectRole::knots}}}};

  static Status validate(const EffectSetting& setting) noexcept {
    const EffectSetting::Values& v = setting.parameters[0];
    if (v.count % 2 != 0)
      return Status::invalid("profile", "needs a position and a friction for each knot");
    for (std::size_t i = 2; i < v.count; i += 2)
      if (!(v.value[i] > v.value[i - 2]))
        return Status::invalid("profile", "needs positions in ascending order");
    return {};
  }
  void configure(const EffectSetting& setting, const DriveFacts& /*drive*/) noexcept {
    const EffectSetting::Values& v = setting.parameters[0];
    knots_ = v.count / 2;
    for (std::size_t i = 0; i < knots_; ++i) {
      position_[i] = static_cast<Real>(v.value[2 * i]);
      friction_[i] = static_cast<Real>(v.value[2 * i + 1]);
      const bool last = i + 1 == knots_;
      slope_[i] = last ? Real(0)
                       : static_cast<Real>((v.value[2 * i + 3] - v.value[2 * i + 1]) /
                                           (v.value[2 * i + 2] - v.value[2 * i]));
    }
  }
  void reset() noexcept {}
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    std::size_t below = 0;
    for (std::size_t i = 1; i < knots_; ++i) below = m.position >= position_[i] ? i : below;
    const Real beyond = m.position - position_[below];
    return (friction_[below] + (beyond > 0 ? slope_[below] * beyond : Real(0))) * m.direction;
  }

 private:
  std::size_t knots_ = 0;
  std::array<Real, kMaxEffectValues / 2> position_{};
  std::array<Real, kMaxEffectValues / 2> friction_{};
  std::array<Real, kMaxEffectValues / 2> slope_{};
};

}  // namespace servosense
