// Torque ripple: cogging, pole pairs, slots, ball pass.
//   F = sum A_i sin(n_i theta + p_i)
// theta the angle within a turn of motor or screw; orders n_i need not be whole. The phase is that
// of one power-up when the encoder is incremental.
#pragma once

#include "servosense/core/status.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"
#include "servosense/model/turn_harmonics.hpp"

namespace servosense {

template <RealNumber Real>
class TorqueRipple {
 public:
  static constexpr EffectInfo info = effect_info("torque-ripple");
  static constexpr EffectTraits traits = {
      .equation = "sum A sin(n theta + p)",
      .scope = "power-up",
      .where = "motor-angle",
      .signature = "a sine of the turn angle, as large at every speed",
      .confused_with = {"encoder-eccentricity", "time-locked-vibration"},
      .splitting_motion = "constant speeds a factor of three apart",
      .search = {{{EffectRole::order, 0.25, 60}, {EffectRole::amplitude}, {EffectRole::phase}}}};

  static Status validate(const EffectSetting& s) noexcept {
    return TurnHarmonics<Real>::validate(s.parameters[0], s.parameters[1], s.parameters[2]);
  }
  void configure(const EffectSetting& s, const DriveFacts& /*drive*/) noexcept {
    harmonics_.configure(s.parameters[0], s.parameters[1], s.parameters[2]);
  }
  void reset() noexcept { harmonics_.reset(); }
  Real force(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    return harmonics_.process(m.turn_angle_rad);
  }

 private:
  TurnHarmonics<Real> harmonics_;
};

}  // namespace servosense
