// Error between screw and scale: cyclic once or more often a turn, and progressive along the
// stroke.
//   x_measured = x + b x + sum A_i sin(n_i theta + p_i)
// It shows in the force as inertia times the curvature of the error, so with the square of speed.
// In the observer it is evaluated at the measured position: what that neglects is the product of
// error and slope.
#pragma once

#include "servosense/core/status.hpp"
#include "servosense/model/effect.hpp"
#include "servosense/model/motion_state.hpp"
#include "servosense/model/turn_harmonics.hpp"

namespace servosense {

template <RealNumber Real>
class LeadError {
 public:
  static constexpr EffectInfo info = effect_info("lead-error");
  static constexpr EffectTraits traits = {
      .equation = "x_measured = x + b x + sum A sin(n theta + p)",
      .where = "motor-angle",
      .signature = "the scale departs from the motor once a turn, or more with every turn",
      .confused_with = {"encoder-eccentricity", "backlash"},
      .splitting_motion = "a scale on the stage",
      .search = {{{EffectRole::amplitude},
                  {EffectRole::order, 0.5, 8},
                  {EffectRole::none},
                  {EffectRole::phase}}}};

  static Status validate(const EffectSetting& s) noexcept {
    return TurnHarmonics<Real>::validate(s.parameters[1], s.parameters[0], s.parameters[3]);
  }
  void configure(const EffectSetting& s, const DriveFacts& /*drive*/) noexcept {
    harmonics_.configure(s.parameters[1], s.parameters[0], s.parameters[3]);
    slope_ = static_cast<Real>(s.scalar(2));
  }
  void reset() noexcept { harmonics_.reset(); }
  Real position_error(const MotionState<Real>& m) SERVOSENSE_NONBLOCKING {
    return slope_ * m.position + harmonics_.process(m.turn_angle_rad);
  }

 private:
  TurnHarmonics<Real> harmonics_;
  Real slope_ = 0;
};

}  // namespace servosense
