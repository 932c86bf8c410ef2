// What an effect of the drive model looks like.
//
// An effect is one small class in model/effects/, one line in model/drive_effects.hpp and its name
// and parameters in core/effect_keys.hpp. It takes part in the physics through any of these members
// (leave out what does not apply):
//
//   Real force(const MotionState<Real>&)      force or torque the motor must carry in addition
//   Real viscous() const                      the same where it is proportional to velocity: joins
//                                             the model's own term and shares its filters
//   Real acting_effort(Real, const MotionState<Real>&)   effort that acts, given the effort that is
//                                             reported; of the motion all but the effort is known
//   Real position_error(const MotionState<Real>&)  measured minus true position
//   Real transmitted(const MotionState<Real>&)     force passed on to a load behind play or a
//   spring LoadShares load_shares() const                 which carries these shares of the drive,
//   Real deflection() const                        motor minus load position
//
//   void configure(const EffectSetting&, const DriveFacts&), void reset()       always
//   static Status validate(const EffectSetting&)      what the range of each value does not say
//   static Status validate(const EffectSetting&, const DriveFacts&)   what it needs of the drive
//   static constexpr EffectTraits traits      how to look for it in measured data (reconcile/)
//   void start(const MotionState<Real>&)      moving steadily like this, not at rest
//   void restart()                            instead of reset() where a gap in the data must not
//                                             empty the state (a clock)
//
// Observer and simulator call the same members, so an effect is written once. The observer is fed
// with measured motion at the servo rate, the simulator with its own at the rate of its steps;
// `increment`, `turn_angle_rad` and `direction` are exact in both, `velocity` lags in the observer,
// so an effect with a state is driven by increments.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

#include "servosense/core/effect_keys.hpp"
#include "servosense/core/real_time.hpp"

namespace servosense {

inline constexpr std::size_t kMaxEffectParameters = 4;
inline constexpr std::size_t kMaxEffectValues = 16;

/// One parameter of an effect, under its name in the machine file.
struct EffectParameter {
  const char* key = "";
  double low = 0;  ///< physical range, inclusive
  double high = 0;
  bool list = false;             ///< a comma list instead of one number
  const char* turning_key = "";  ///< its name on a channel that turns; empty: the same
  bool optional = false;         ///< may be left out

  [[nodiscard]] constexpr const char* key_for(bool turning) const noexcept {
    return turning && turning_key[0] != '\0' ? turning_key : key;
  }
};

/// Name and parameters of an effect.
struct EffectInfo {
  const char* name = "";
  std::array<EffectParameter, kMaxEffectParameters> parameters{};
  [[nodiscard]] constexpr std::size_t parameter_count() const noexcept {
    std::size_t n = 0;
    while (n < parameters.size() && parameters[n].key[0] != '\0') ++n;
    return n;
  }
};

namespace detail {
void there_is_no_effect_of_this_name();
}

/// What core/effect_keys.hpp says of the effect called `name`; does not compile without.
[[nodiscard]] consteval EffectInfo effect_info(std::string_view name) {
  EffectInfo info;
  for (const std::string_view known : kEffectNames)
    if (known == name) info.name = known.data();
  if (info.name[0] == '\0') detail::there_is_no_effect_of_this_name();
  std::size_t n = 0;
  for (const EffectKey& key : kEffectKeys)
    if (key.effect == name)
      info.parameters[n++] = {key.key,          key.low,         key.high,
                              key.takes_many(), key.turning.key, key.optional};
  return info;
}

/// What a parameter is to a search for the effect in measured data.
enum class EffectRole : unsigned char {
  none,       ///< stays at its default
  linear,     ///< a column of its own: the response to 1
  scaled,     ///< searched at unit strength, then grows with the linear parameter
  searched,   ///< enters nonlinearly: tried over its range
  amplitude,  ///< of a sine; with `phase`, two columns
  phase,
  order,   ///< of a sine, searched in the residual's order spectrum
  offset,  ///< shifts the effect by a constant force
  knots,   ///< position and value pairs: a column a knot
};

/// In which unit the range of a search is given.
enum class EffectRange : unsigned char {
  absolute,
  of_top_speed,
  of_record,       ///< its duration
  of_top_current,  ///< [A]
  of_knee,         ///< of the model's friction
  per_knee,
  of_band,  ///< highest frequency of the comparison [Hz]
};

struct EffectSearch {
  EffectRole role = EffectRole::none;
  double low = 0;
  double high = 0;
  EffectRange in = EffectRange::absolute;
  unsigned points = 12;
};

/// What a search for missing effects needs beyond EffectInfo; the controller never reads it.
struct EffectTraits {
  const char* equation = "";      ///< as in docs/effects.md
  const char* scope = "machine";  ///< machine, or power-up: a phase that an encoder's zero moves
  const char* where = "";         ///< the quantity in which the residual shows it
  const char* signature = "";
  std::array<const char*, 3> confused_with{};  ///< names; nullptr where there are fewer
  const char* splitting_motion = "";           ///< tells it from what it is confused with
  bool of_current = false;  ///< says nothing of an effort that the drive reports as torque or force
  bool sized = false;       ///< nothing linear: the response has its physical size
  std::array<EffectSearch, kMaxEffectParameters> search{};  ///< in the order of the parameters
};

/// Values of one effect, in the order of its EffectInfo.
struct EffectSetting {
  struct Values {
    std::array<double, kMaxEffectValues> value{};
    std::size_t count = 0;
  };
  std::size_t effect = 0;  ///< index in DriveEffects
  std::array<Values, kMaxEffectParameters> parameters{};
  [[nodiscard]] constexpr double scalar(std::size_t parameter) const noexcept {
    return parameters[parameter].value[0];
  }
};

/// What an effect may need to know about the drive it belongs to. Units as in DriveModelConfig.
struct DriveFacts {
  double sample_period_s = 125e-6;  ///< between two calls
  double inertia = 0;
  double viscous = 0;
  double coulomb = 0;
  double constant_load = 0;
  double friction_knee = 5e-6;
  double effort_per_ampere = 0;     ///< N/A or Nm/A; 0 when not known
  double unit_per_turn = 0;         ///< m or rad per turn; 0 when not known
  double load_inertia_share = 0.5;  ///< of the drive's inertia that the stage or tool has
  double load_friction_share = 0.5;
  const EffectSetting* backlash = nullptr;  ///< switched on as well; valid while configuring
  const EffectSetting* coupling = nullptr;
};

/// Shares of the drive that move with a load behind play or a spring, 0..1.
struct LoadShares {
  double inertia = 0;
  double friction = 0;
  double constant_load = 0;
};

}  // namespace servosense
