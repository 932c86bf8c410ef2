// The effects a drive model can contain, and the set of those that are switched on.
//
// To add one: write its class (model/effect.hpp says how) and put it in the list below.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <tuple>
#include <utility>

#include "servosense/core/status.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/effects/asymmetric_friction.hpp"
#include "servosense/model/effects/constant_load.hpp"
#include "servosense/model/effects/quadratic_drag.hpp"
#include "servosense/model/effects/stribeck_friction.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
using DriveEffectList = std::tuple<StribeckFriction<Real>, AsymmetricFriction<Real>,
                                   QuadraticDrag<Real>, ConstantLoad<Real>>;

inline constexpr std::size_t kDriveEffectCount = std::tuple_size_v<DriveEffectList<double>>;
inline constexpr std::size_t kMaxActiveEffects = 8;

namespace detail {
template <std::size_t... I>
constexpr std::array<EffectInfo, sizeof...(I)> drive_effect_infos(std::index_sequence<I...>) {
  return {std::tuple_element_t<I, DriveEffectList<double>>::info...};
}
}  // namespace detail

/// Name and parameters of every drive effect, in list order.
inline constexpr auto kDriveEffects =
    detail::drive_effect_infos(std::make_index_sequence<kDriveEffectCount>{});

/// Index of the effect called `name`, or kDriveEffectCount when there is none.
[[nodiscard]] constexpr std::size_t drive_effect_index(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kDriveEffectCount; ++i)
    if (name == kDriveEffects[i].name) return i;
  return kDriveEffectCount;
}

struct DriveEffectsConfig {
  double sample_period_s = 125e-6;
  std::array<EffectSetting, kMaxActiveEffects> settings{};
  std::size_t count = 0;
};

/// The effects that are switched on. An effect that is off costs nothing when none is on, and one
/// test of a bit otherwise.
template <RealNumber Real>
class DriveEffects {
 public:
  using Config = DriveEffectsConfig;

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (c.count > kMaxActiveEffects) return Status::invalid("effects", "at most eight at a time");
    for (std::size_t i = 0; i < c.count; ++i) {
      const EffectSetting& s = c.settings[i];
      if (s.effect >= kDriveEffectCount) return Status::invalid("effects", "no such effect");
      for (std::size_t j = 0; j < i; ++j)
        if (c.settings[j].effect == s.effect)
          return Status::invalid("effects", "the same one twice");
      const EffectInfo& info = kDriveEffects[s.effect];
      for (std::size_t p = 0; p < info.parameter_count(); ++p) {
        const EffectParameter& parameter = info.parameters[p];
        const EffectSetting::Values& values = s.parameters[p];
        if (values.count < 1 || values.count > (parameter.list ? kMaxEffectValues : 1))
          return Status::invalid(parameter.key,
                                 "needs one value, or up to sixteen if it is a list");
        for (std::size_t k = 0; k < values.count; ++k)
          if (!(values.value[k] >= parameter.low && values.value[k] <= parameter.high))
            return Status::invalid(parameter.key, "is outside its physical range");
      }
    }
    return {};
  }

  void configure(const Config& c) noexcept {
    active_ = 0;
    for (std::size_t i = 0; i < c.count; ++i) {
      active_ |= std::uint32_t{1} << c.settings[i].effect;
      for_each([&](auto& effect, std::size_t index) {
        if (index == c.settings[i].effect) effect.configure(c.settings[i], c.sample_period_s);
      });
    }
    reset();
  }
  void reset() noexcept {
    for_each([](auto& effect, std::size_t) { effect.reset(); });
  }
  [[nodiscard]] bool any() const noexcept { return active_ != 0; }

  /// Sum of the forces of all active effects.
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    Real sum = 0;
    if (active_ == 0) return sum;
    for_each([&](auto& effect, std::size_t index) {
      if constexpr (requires { effect.force(m); })
        if ((active_ >> index & 1U) != 0) sum += effect.force(m);
    });
    return sum;
  }

 private:
  template <typename Visit>
  void for_each(Visit visit) noexcept {
    [&]<std::size_t... I>(std::index_sequence<I...>) { (visit(std::get<I>(effects_), I), ...); }
    (std::make_index_sequence<kDriveEffectCount>{});
  }

  DriveEffectList<Real> effects_;
  std::uint32_t active_ = 0;
};

}  // namespace servosense
