// Spindle and feed axis as the machine file describes them, and their translation into the
// configurations of the blocks.
//
// Koike 2016, eq. 2-18 and 2-20 repaired: torque on the screw is R times the force on the stage,
// R = lead / 2 pi; C_screw = C_theta + R C_stage. The feed axis is therefore kept in units of the
// stage: effort [N] = torque constant * current / R.
#pragma once

#include "servosense/core/drive_input.hpp"
#include "servosense/core/plausible.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/model/drive_model.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

struct ObserverCutoffs {
  double disturbance_cutoff_rad_s = 500;
  double velocity_cutoff_rad_s = 500;
};

/// A current that no motor takes is none, whatever force it would be; a ratio may be anything.
constexpr void limit_effort(DriveSignal signal, bool is_ratio, DriveInputConfig& c) noexcept {
  if (is_ratio) c.max_effort = 0;
  const double most = kImpossibleCurrent_A * (c.effort_per_unit < 0 ? -1 : 1) * c.effort_per_unit;
  if (signal.effort == EffortKind::current_A && most > 0 && most < c.max_effort)
    c.max_effort = most;
}

/// Presliding distance where none is given: of a linear axis, and of a table, which is that at a
/// radius of 50 mm.
inline constexpr double kAxisKnee_m = 5e-6;
inline constexpr double kTableKnee_rad = 1e-4;

/// Of a spindle or an axis that turns.
struct SpindleConfig {
  bool effort_is_current = true;  ///< else torque is reported
  bool effort_is_ratio = false;   ///< its numbers have no unit
  double effort_share = 1;        ///< of the whole that a reported torque is
  double torque_constant_Nm_per_A = 1;
  double inertia_kg_m2 = 0;
  double viscous_friction_Nm_s_per_rad = 0;
  double coulomb_friction_Nm = 0;
  double encoder_counts_per_rev = 0;  ///< 0 when no counts are used
  unsigned counter_bits = 32;
  double current_update_hz = 0;  ///< rate of new currents; 0: as they come
  double friction_knee_rad = 1e-3;
  ObserverCutoffs observer;
  DriveEffectsConfig effects;

  [[nodiscard]] DriveInputConfig input(DriveSignal signal, double sample_period_s) const noexcept {
    DriveInputConfig c;
    c.kind = signal.motion;
    c.sample_period_s = sample_period_s;
    c.unit_per_count = encoder_counts_per_rev > 0 ? kTwoPi / encoder_counts_per_rev : 0;
    c.counter_bits = counter_bits;
    c.unit_per_turn = kTwoPi;
    c.max_acceleration = kImpossibleAcceleration_rad_s2;
    c.max_effort = kImpossibleTorque_Nm;
    c.effort_update_s = current_update_hz > 1 ? 1 / current_update_hz : 0;
    c.effort_per_unit =
        signal.effort == EffortKind::current_A ? torque_constant_Nm_per_A : 1 / effort_share;
    limit_effort(signal, effort_is_ratio, c);
    return c;
  }
  [[nodiscard]] DisturbanceObserverConfig disturbance_observer(
      double sample_period_s, const ObserverCutoffs& cutoffs) const noexcept {
    DisturbanceObserverConfig c;
    c.sample_period_s = sample_period_s;
    c.disturbance_cutoff_rad_s = cutoffs.disturbance_cutoff_rad_s;
    c.velocity_cutoff_rad_s = cutoffs.velocity_cutoff_rad_s;
    c.drive.inertia = inertia_kg_m2;
    c.drive.viscous = viscous_friction_Nm_s_per_rad;
    c.drive.coulomb = coulomb_friction_Nm;
    c.drive.friction_knee = friction_knee_rad;
    c.drive.effort_per_ampere = effort_is_current ? torque_constant_Nm_per_A : 0;
    c.drive.effects = effects;
    c.drive.unit_per_turn = kTwoPi;
    return c;
  }
};

struct AxisConfig {
  double lead_m = 0;
  double equivalent_mass_kg = 0;  ///< stage plus reflected screw and motor inertia
  double moving_mass_kg = 0;      ///< what gravity pulls at
  bool vertical = false;
  double viscous_friction_N_s_per_m = 0;
  double coulomb_friction_N = 0;
  bool effort_is_current = true;        ///< else torque or force is reported
  bool effort_is_ratio = false;         ///< its numbers have no unit
  double effort_share = 1;              ///< of the whole that a reported torque or force is
  double torque_constant_Nm_per_A = 0;  ///< at the motor; or
  double force_constant_N_per_A = 0;    ///< at the stage. Exactly one is set, or neither.
  double encoder_counts_per_rev = 0;
  unsigned counter_bits = 32;
  double current_update_hz = 0;  ///< rate of new currents; 0: as they come
  double friction_knee_m = kAxisKnee_m;
  ObserverCutoffs observer;
  DriveEffectsConfig effects;

  /// Force at the stage per ampere; 1 when no constant is given.
  [[nodiscard]] double force_per_ampere() const noexcept {
    if (force_constant_N_per_A > 0) return force_constant_N_per_A;
    if (torque_constant_Nm_per_A > 0) return torque_constant_Nm_per_A / m_per_rad(lead_m);
    return 1;
  }
  [[nodiscard]] DriveInputConfig input(DriveSignal signal, double sample_period_s) const noexcept {
    DriveInputConfig c;
    c.kind = signal.motion;
    c.sample_period_s = sample_period_s;
    c.unit_per_count = encoder_counts_per_rev > 0 ? lead_m / encoder_counts_per_rev : 0;
    c.counter_bits = counter_bits;
    c.unit_per_turn = lead_m > 0 ? lead_m : 1;
    c.max_acceleration = kImpossibleAcceleration_m_s2;
    c.max_effort = kImpossibleForce_N;
    c.effort_update_s = current_update_hz > 1 ? 1 / current_update_hz : 0;
    if (signal.effort == EffortKind::current_A) c.effort_per_unit = force_per_ampere();
    if (signal.effort == EffortKind::torque_Nm)
      c.effort_per_unit = 1 / m_per_rad(c.unit_per_turn) / effort_share;
    if (signal.effort == EffortKind::force_N) c.effort_per_unit = 1 / effort_share;
    limit_effort(signal, effort_is_ratio, c);
    return c;
  }
  [[nodiscard]] DisturbanceObserverConfig disturbance_observer(
      double sample_period_s, const ObserverCutoffs& cutoffs) const noexcept {
    DisturbanceObserverConfig c;
    c.sample_period_s = sample_period_s;
    c.disturbance_cutoff_rad_s = cutoffs.disturbance_cutoff_rad_s;
    c.velocity_cutoff_rad_s = cutoffs.velocity_cutoff_rad_s;
    c.drive.inertia = equivalent_mass_kg;
    c.drive.viscous = viscous_friction_N_s_per_m;
    c.drive.coulomb = coulomb_friction_N;
    c.drive.constant_load = vertical ? moving_mass_kg * kGravity_m_s2 : 0;
    c.drive.friction_knee = friction_knee_m;
    c.drive.effort_per_ampere = effort_is_current ? force_per_ampere() : 0;
    c.drive.effects = effects;
    c.drive.unit_per_turn = lead_m;
    // The stage is what moves on the far side of play and springs.
    const double share = equivalent_mass_kg > 0 ? moving_mass_kg / equivalent_mass_kg : 0;
    if (share >= 0.01 && share <= 0.99) c.drive.load_inertia_share = share;
    return c;
  }
};

}  // namespace servosense
