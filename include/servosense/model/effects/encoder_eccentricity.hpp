// Eccentric encoder disc: a once-per-turn error of the measured angle.
//   theta_measured = theta + A sin(theta + p)
// It shows as an apparent acceleration, so with the square of speed. Evaluated at the measured
// angle in the observer: neglects A^2 / 2, 0.06 rad at the largest A.
#pragma once

#include <cstdint>

#include "servosense/core/fast_math.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"

namespace servosense {

template <RealNumber Real>
class EncoderEccentricity {
 public:
  static constexpr EffectInfo info = effect_info("encoder-eccentricity");
  static constexpr EffectTraits traits = {
      .equation = "theta_measured = theta + A sin(theta + p)",
      .scope = "power-up",
      .where = "motor-angle",
      .signature = "once a turn, growing with the square of speed",
      .confused_with = {"lead-error", "torque-ripple"},
      .splitting_motion = "constant speeds a factor of three apart",
      .search = {{{EffectRole::amplitude}, {EffectRole::phase}}}};

  static Status validate(const EffectSetting& /*setting*/, const DriveFacts& drive) noexcept {
    return drive.unit_per_turn > 0
               ? Status{}
               : Status::invalid("unit_per_turn", "must be known for an eccentric encoder");
  }
  void configure(const EffectSetting& setting, const DriveFacts& drive) noexcept {
    amplitude_ = static_cast<Real>(setting.scalar(0) * drive.unit_per_turn / kTwoPi);
    const double turns = setting.scalar(1) / kTwoPi;
    phase_rad_ =
        static_cast<Real>(kTwoPi * (turns - static_cast<double>(static_cast<std::int64_t>(turns))));
  }
  void reset() noexcept {}
  Real position_error(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    return amplitude_ * sine_cosine(m.turn_angle_rad + phase_rad_).sine;
  }

 private:
  Real amplitude_ = 0;  // m or rad
  Real phase_rad_ = 0;
};

}  // namespace servosense
