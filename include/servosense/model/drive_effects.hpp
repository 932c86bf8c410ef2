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
#include "servosense/model/effects/backlash.hpp"
#include "servosense/model/effects/constant_load.hpp"
#include "servosense/model/effects/coulomb_friction.hpp"
#include "servosense/model/effects/current_loop_lag.hpp"
#include "servosense/model/effects/encoder_eccentricity.hpp"
#include "servosense/model/effects/field_weakening.hpp"
#include "servosense/model/effects/flexible_coupling.hpp"
#include "servosense/model/effects/lead_error.hpp"
#include "servosense/model/effects/load_dependent_friction.hpp"
#include "servosense/model/effects/position_dependent_friction.hpp"
#include "servosense/model/effects/presliding_hysteresis.hpp"
#include "servosense/model/effects/quadratic_drag.hpp"
#include "servosense/model/effects/spring_load.hpp"
#include "servosense/model/effects/stribeck_friction.hpp"
#include "servosense/model/effects/thermal_friction_drift.hpp"
#include "servosense/model/effects/thermal_viscous_drift.hpp"
#include "servosense/model/effects/torque_ripple.hpp"
#include "servosense/model/effects/torque_saturation.hpp"
#include "servosense/model/effects/transport_delay.hpp"
#include "servosense/model/effects/viscous_friction.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
using DriveEffectList =
    std::tuple<ViscousFriction<Real>, CoulombFriction<Real>, StribeckFriction<Real>,
               AsymmetricFriction<Real>, PreslidingHysteresis<Real>, QuadraticDrag<Real>,
               PositionDependentFriction<Real>, ThermalFrictionDrift<Real>, ConstantLoad<Real>,
               SpringLoad<Real>, TorqueRipple<Real>, Backlash<Real>, FlexibleCoupling<Real>,
               TransportDelay<Real>, CurrentLoopLag<Real>, EncoderEccentricity<Real>,
               LeadError<Real>, LoadDependentFriction<Real>, ThermalViscousDrift<Real>,
               TorqueSaturation<Real>, FieldWeakening<Real>>;

inline constexpr std::size_t kDriveEffectCount = std::tuple_size_v<DriveEffectList<double>>;
inline constexpr std::size_t kMaxActiveEffects = 8;
static_assert(kDriveEffectCount <= 32, "one bit each");

namespace detail {
// std::tuple is not trivially copyable, this is.
template <typename List>
struct EffectStore;
template <typename... Effect>
struct EffectStore<std::tuple<Effect...>> : Effect... {};

template <std::size_t... I>
constexpr std::array<EffectInfo, sizeof...(I)> drive_effect_infos(std::index_sequence<I...>) {
  return {std::tuple_element_t<I, DriveEffectList<double>>::info...};
}
template <std::size_t... I>
constexpr std::array<EffectTraits, sizeof...(I)> drive_effect_traits(std::index_sequence<I...>) {
  return {std::tuple_element_t<I, DriveEffectList<double>>::traits...};
}
}  // namespace detail

/// Name and parameters of every drive effect, in list order.
inline constexpr auto kDriveEffects =
    detail::drive_effect_infos(std::make_index_sequence<kDriveEffectCount>{});

/// How to look for each of them in measured data, in list order.
inline constexpr auto kDriveEffectTraits =
    detail::drive_effect_traits(std::make_index_sequence<kDriveEffectCount>{});

/// Index of the effect called `name`, or kDriveEffectCount when there is none.
[[nodiscard]] constexpr std::size_t drive_effect_index(std::string_view name) noexcept {
  for (std::size_t i = 0; i < kDriveEffectCount; ++i)
    if (name == kDriveEffects[i].name) return i;
  return kDriveEffectCount;
}

namespace detail {
template <typename Effects>
constexpr const EffectSetting* find_effect(const Effects& effects, std::string_view name) noexcept {
  for (std::size_t i = 0; i < effects.count; ++i) {
    const EffectSetting& s = effects.settings[i];
    if (s.effect < kDriveEffectCount && name == kDriveEffects[s.effect].name) return &s;
  }
  return nullptr;
}
}  // namespace detail

/// The effects of a drive where they lie: in flash, or in a DriveEffectsConfig that must outlive
/// the use of this. Room for every value makes the settings of one drive 4.4 kB, too much to be
/// copied about on a controller.
struct DriveEffectsView {
  double sample_period_s = 125e-6;
  const EffectSetting* settings = nullptr;
  std::size_t count = 0;

  /// The settings of the effect called `name`, or nullptr when it is off.
  [[nodiscard]] constexpr const EffectSetting* find(std::string_view name) const noexcept {
    return detail::find_effect(*this, name);
  }
};

/// The effects of a drive by value, for hosts.
struct DriveEffectsConfig {
  double sample_period_s = 125e-6;
  std::array<EffectSetting, kMaxActiveEffects> settings{};
  std::size_t count = 0;

  /// The settings of the effect called `name`, or nullptr when it is off.
  [[nodiscard]] constexpr const EffectSetting* find(std::string_view name) const noexcept {
    return detail::find_effect(*this, name);
  }

  constexpr operator DriveEffectsView() const& noexcept {
    return {sample_period_s, settings.data(), count};
  }
  operator DriveEffectsView() && = delete;  // would outlive its settings
  operator DriveEffectsView() const&& = delete;
};

/// Takes out what a current alone shows (EffectTraits::of_current): of a drive that reports torque
/// or force it says nothing. How many there were.
constexpr std::size_t take_out_effects_of_current(DriveEffectsConfig& effects) noexcept {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < effects.count; ++i)
    if (!kDriveEffectTraits[effects.settings[i].effect].of_current)
      effects.settings[kept++] = effects.settings[i];
  const std::size_t taken = effects.count - kept;
  effects.count = kept;
  return taken;
}

/// The effects that are switched on. An effect that is off costs nothing when none is on, and one
/// test of a bit otherwise.
template <RealNumber Real>
class DriveEffects {
 public:
  using Config = DriveEffectsConfig;

  /// The settings by themselves.
  static Status validate(const Config& c) noexcept { return validate(DriveEffectsView(c)); }
  static Status validate(const DriveEffectsView& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (c.count > kMaxActiveEffects) return Status::invalid("effects", "at most eight at a time");
    for (std::size_t i = 0; i < c.count; ++i) {
      const EffectSetting& s = c.settings[i];
      if (s.effect >= kDriveEffectCount) return Status::invalid("effects", "no such effect");
      for (std::size_t j = 0; j < i; ++j)
        if (c.settings[j].effect == s.effect)
          return Status::invalid("effects", "the same one twice");
      if (const Status status = validate_values(s); !status.ok()) return status;
    }
    return {};
  }

  /// The settings in the drive they are meant for.
  static Status validate(const Config& c, const DriveFacts& drive) noexcept {
    return validate(DriveEffectsView(c), drive);
  }
  static Status validate(const DriveEffectsView& c, const DriveFacts& drive) noexcept {
    if (const Status status = validate(c); !status.ok()) return status;
    const DriveFacts facts = with_settings(c, drive);
    Status status;
    for (std::size_t i = 0; i < c.count && status.ok(); ++i)
      for_type(c.settings[i].effect, [&]<typename Effect>() {
        if constexpr (requires { Effect::validate(c.settings[i], facts); })
          status = Effect::validate(c.settings[i], facts);
      });
    return status;
  }

  /// Requires validate(c, drive).ok().
  void configure(const Config& c, const DriveFacts& drive = {}) noexcept {
    configure(DriveEffectsView(c), drive);
  }
  void configure(const DriveEffectsView& c, const DriveFacts& drive = {}) noexcept {
    active_ = 0;
    const DriveFacts facts = with_settings(c, drive);
    for (std::size_t i = 0; i < c.count; ++i) {
      active_ |= std::uint32_t{1} << c.settings[i].effect;
      for_each([&](auto& effect, std::size_t index) {
        if (index == c.settings[i].effect) effect.configure(c.settings[i], facts);
      });
    }
    reset();
  }

  /// At rest, all states empty.
  void reset() noexcept {
    if (active_ == 0) return;
    for_active([](auto& effect) { effect.reset(); });
  }
  /// After a gap: all states empty but those that live through it.
  void restart() noexcept {
    if (active_ == 0) return;
    for_active([](auto& effect) {
      if constexpr (requires { effect.restart(); })
        effect.restart();
      else
        effect.reset();
    });
  }
  /// As if the drive had always moved like this.
  void start(const MotionState<Real>& m) noexcept {
    if (active_ == 0) return;
    for_active([&](auto& effect) {
      if constexpr (requires { effect.start(m); }) effect.start(m);
    });
  }
  [[nodiscard]] bool any() const noexcept { return active_ != 0; }

  /// Sum of what all active effects demand of the motor.
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    Real sum = 0;
    if (active_ == 0) return sum;
    for_active([&](auto& effect) {
      if constexpr (requires { effect.force(m); }) sum += effect.force(m);
      if constexpr (requires { effect.transmitted(m); }) sum += effect.transmitted(m);
    });
    return sum;
  }

  /// Effort that acts, given the effort that is reported and all else of `m`. Call once per
  /// sample.
  Real acting_effort(Real reported, const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    if (active_ == 0) return reported;
    for_active([&](auto& effect) {
      if constexpr (requires { effect.acting_effort(reported, m); })
        reported = effect.acting_effort(reported, m);
    });
    return reported;
  }

  /// Measured minus true position.
  Real position_error(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    Real sum = 0;
    if (active_ == 0) return sum;
    for_active([&](auto& effect) {
      if constexpr (requires { effect.position_error(m); }) sum += effect.position_error(m);
    });
    return sum;
  }

  /// Sum of the coefficients of viscous friction.
  [[nodiscard]] Real viscous() const noexcept {
    Real sum = 0;
    for_active([&](const auto& effect) {
      if constexpr (requires { effect.viscous(); }) sum += effect.viscous();
    });
    return sum;
  }
  /// What moves with a load behind play or a spring; nothing when there is none.
  [[nodiscard]] LoadShares load_shares() const noexcept {
    LoadShares shares;
    for_active([&](const auto& effect) {
      if constexpr (requires { effect.load_shares(); })
        if (effect.load_shares().inertia > 0) shares = effect.load_shares();
    });
    return shares;
  }
  /// Motor minus load position.
  [[nodiscard]] Real deflection() const noexcept {
    Real sum = 0;
    if (active_ == 0) return sum;
    for_active([&](const auto& effect) {
      if constexpr (requires { effect.deflection(); }) sum += effect.deflection();
    });
    return sum;
  }

 private:
  static Status validate_values(const EffectSetting& s) noexcept {
    const EffectInfo& info = kDriveEffects[s.effect];
    for (std::size_t p = 0; p < info.parameter_count(); ++p) {
      const EffectParameter& parameter = info.parameters[p];
      const EffectSetting::Values& values = s.parameters[p];
      if (values.count == 0 && parameter.optional) continue;
      if (values.count < 1 || values.count > (parameter.list ? kMaxEffectValues : 1))
        return Status::invalid(parameter.key, "needs one value, or up to sixteen if it is a list");
      for (std::size_t k = 0; k < values.count; ++k)
        if (!(values.value[k] >= parameter.low && values.value[k] <= parameter.high))
          return Status::invalid(parameter.key, "is outside its physical range");
    }
    Status status;
    for_type(s.effect, [&]<typename Effect>() {
      if constexpr (requires { Effect::validate(s); }) status = Effect::validate(s);
    });
    return status;
  }

  static DriveFacts with_settings(const DriveEffectsView& c, const DriveFacts& drive) noexcept {
    DriveFacts facts = drive;
    facts.sample_period_s = c.sample_period_s;
    facts.backlash = c.find("backlash");
    facts.coupling = c.find("flexible-coupling");
    return facts;
  }

  template <typename Visit>
  static void for_type(std::size_t index, Visit visit) noexcept {
    [&]<std::size_t... I>(std::index_sequence<I...>) {
      ((I == index ? visit.template operator()<std::tuple_element_t<I, DriveEffectList<Real>>>()
                   : void()),
       ...);
    }
    (std::make_index_sequence<kDriveEffectCount>{});
  }
  template <typename Visit>
  void for_each(Visit visit) noexcept {
    [&]<std::size_t... I>(std::index_sequence<I...>) { (visit(get<I>(), I), ...); }
    (std::make_index_sequence<kDriveEffectCount>{});
  }
  // A visit that does nothing for an effect leaves no test behind: the compiler drops it.
  template <typename Visit>
  void for_active(Visit visit) noexcept {
    [&]<std::size_t... I>(std::index_sequence<I...>) {
      ((is_active(I) ? visit(get<I>()) : void()), ...);
    }
    (std::make_index_sequence<kDriveEffectCount>{});
  }
  template <typename Visit>
  void for_active(Visit visit) const noexcept {
    [&]<std::size_t... I>(std::index_sequence<I...>) {
      ((is_active(I) ? visit(get<I>()) : void()), ...);
    }
    (std::make_index_sequence<kDriveEffectCount>{});
  }
  [[nodiscard]] bool is_active(std::size_t index) const noexcept {
    return (active_ >> index & 1U) != 0;
  }

  template <std::size_t I>
  auto& get() noexcept {
    return static_cast<std::tuple_element_t<I, DriveEffectList<Real>>&>(effects_);
  }
  template <std::size_t I>
  [[nodiscard]] const auto& get() const noexcept {
    return static_cast<const std::tuple_element_t<I, DriveEffectList<Real>>&>(effects_);
  }

  detail::EffectStore<DriveEffectList<Real>> effects_;
  std::uint32_t active_ = 0;
};

}  // namespace servosense
