// Configuration of the collision monitor (monitors/collision.hpp).
#pragma once

#include <array>

#include "servosense/monitors/motion_phase.hpp"

namespace servosense {

struct CollisionConfig {
  double sample_period_s = 125e-6;
  double cutoff_rad_s = 335;
  std::array<double, 2> notch_hz = {1000, 2000};  ///< 0 = none
  double notch_quality = 2;
  double threshold_N_per_s = 0;  ///< on |jerk - mean|; 0 = off, the monitor idles
  double mean_N_per_s = 0;
  /// On |jerk - mean| in each phase of motion, in the order of MotionPhase; 0: threshold_N_per_s.
  std::array<double, kMotionPhases> phase_threshold_N_per_s{};
  double accelerating_m_s2 = 2;  ///< above it the axis accelerates (MotionPhaseConfig)
  double standing_m_s = 2e-3;    ///< below it the axis stands, likewise
  /// On |jerk - mean| while the tool cuts; 0 = not known, unarmed in the cut.
  double cutting_threshold_N_per_s = 0;
  double maximum_feed_m_s = 0.2;  ///< of a cut: a faster move is a rapid
  double wait_s = 0.03;           ///< for the torque of a first contact
  /// Of the cutting edge: forces across the spindle are then held against its torque; 0 = not
  /// known, or an axis along it.
  double tool_radius_m = 0;
  double friction_N = 0;         ///< Coulomb friction, which the force may be wrong by
  double resonance_hz = 0;       ///< of the stage while the motor is held; 0 = none
  double resonance_quality = 1;  ///< of its notch
  double warning_fraction = 0.75;
  double release_fraction = 0.5;
  unsigned release_samples = 800;
  unsigned consecutive_samples = 3;
};

/// Speeds and accelerations of an axis that turns are those that a table of 0.1 m radius makes of a
/// linear axis.
[[nodiscard]] constexpr CollisionConfig collision_defaults(bool turns) noexcept {
  constexpr double kTable_m = 0.1;
  CollisionConfig c;
  if (turns)
    for (double* limit : {&c.accelerating_m_s2, &c.standing_m_s, &c.maximum_feed_m_s})
      *limit /= kTable_m;
  return c;
}

}  // namespace servosense
