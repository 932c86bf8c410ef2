// What an effect of the drive model looks like.
//
// An effect is one small class in model/effects/ and one line in model/drive_effects.hpp. It says
// what it is called, which parameters it takes, and takes part in the physics through any of these
// members (leave out what does not apply):
//
//   Real force(const MotionState<Real>&)      force or torque the motor must carry in addition
//   Real acting_effort(Real commanded)        effort that acts, given the effort that is reported
//   Real position_error(const MotionState<Real>&)  measured minus true position
//   Real transmitted(const MotionState<Real>&)     force passed on to a load behind play or a
//   spring, Real load_share()                              which carries this share of the inertia
//
// Observer and simulator call the same members, so an effect is written once.
#pragma once

#include <array>
#include <cstddef>

#include "servosense/core/real_time.hpp"

namespace servosense {

inline constexpr std::size_t kMaxEffectParameters = 4;
inline constexpr std::size_t kMaxEffectValues = 16;

/// One parameter of an effect, under its name in the machine file.
struct EffectParameter {
  const char* key = "";
  double low = 0;  ///< physical range, inclusive
  double high = 0;
  bool list = false;  ///< a comma list instead of one number
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

}  // namespace servosense
