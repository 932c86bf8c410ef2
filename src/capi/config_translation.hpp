// The C configuration as the monitor stack's, written where the caller has room for it: nothing
// large passes over the stack.
#pragma once

#include <algorithm>

#include "config_fields.hpp"
#include "servosense/monitors/chatter_noise.hpp"
#include "servosense/observer/drive_config.hpp"

namespace servosense::capi {

// What lies in flash is read as the block's own type.
static_assert(sizeof(servosense_effect) == sizeof(EffectSetting));
static_assert(offsetof(servosense_effect, parameters) == offsetof(EffectSetting, parameters));
static_assert(sizeof(servosense_effect::parameters) == sizeof(EffectSetting::parameters));
static_assert(offsetof(EffectSetting::Values, count) == sizeof(double[kMaxEffectValues]));
static_assert(SERVOSENSE_MAX_EFFECTS == kMaxActiveEffects);
static_assert(sizeof(servosense_band_point) == sizeof(TorqueBandPoint<float>));
static_assert(offsetof(servosense_band_point, lower_Nm) ==
              offsetof(TorqueBandPoint<float>, lower_Nm));
static_assert(offsetof(servosense_band_point, upper_Nm) ==
              offsetof(TorqueBandPoint<float>, upper_Nm));
static_assert(offsetof(servosense_band_point, feed) == offsetof(TorqueBandPoint<float>, feed));
static_assert(sizeof(servosense_band_section) == sizeof(TorqueBandSection<float>));
static_assert(offsetof(servosense_band_section, has_air) ==
              offsetof(TorqueBandSection<float>, has_air));
static_assert(offsetof(servosense_band_section, behind_gap) ==
              offsetof(TorqueBandSection<float>, behind_gap));
static_assert(offsetof(servosense_band_section, air_Nm) ==
              offsetof(TorqueBandSection<float>, air_Nm));
static_assert(SERVOSENSE_AXES >= kAxes && SERVOSENSE_AXES <= kAllAxes);

using StackConfig = MonitorStackConfigWith<DisturbanceObserverView, SERVOSENSE_AXES>;

constexpr bool turns(std::size_t axis) noexcept { return is_turning(axis_channel(axis)); }

inline void drive_to_block(const servosense_drive& c, double period, double pace, bool turns,
                           DriveSlotConfig& b, DisturbanceObserverView* tool) noexcept {
  b.present = c.present != 0;
  DriveInputConfig& in = b.input;
  in.kind = static_cast<MotionKind>(c.motion);
  in.sample_period_s = period;
  const double per_turn = turns ? kTwoPi : c.unit_per_turn;
  in.unit_per_turn = per_turn > 0 ? per_turn : 1;
  in.unit_per_count = c.counts_per_turn != 0 ? in.unit_per_turn / c.counts_per_turn : 0;
  in.counter_bits = c.counter_bits;
  in.effort_per_unit = c.effort_per_ampere;
  in.max_acceleration = turns ? kImpossibleAcceleration_rad_s2 : kImpossibleAcceleration_m_s2;
  in.max_effort = turns ? kImpossibleTorque_Nm : kImpossibleForce_N;
  in.watch_effort = true;
  in.effort_update_s = c.effort_update_s;
  if (c.effort_per_ampere != 1)  // a torque or a force has a limit of its own
    limit_effort({MotionKind::counts, EffortKind::current_A}, false, in);
  DisturbanceObserverView& o = b.observer;
  o.sample_period_s = period;
  o.disturbance_cutoff_rad_s = c.cutoff_rad_s;
  o.velocity_cutoff_rad_s = c.velocity_cutoff_rad_s > 0 ? c.velocity_cutoff_rad_s : c.cutoff_rad_s;
  DriveModelView& d = o.drive;
  d.inertia = c.inertia;
  d.viscous = c.viscous_friction;
  d.coulomb = c.coulomb_friction;
  d.constant_load = c.constant_load;
  d.friction_knee = c.friction_knee;
  d.unit_per_turn = per_turn;
  d.effort_per_ampere = c.effort_per_ampere;
  d.load_inertia_share = c.load_inertia_share;
  d.load_friction_share = c.load_friction_share;
  d.effects.settings = reinterpret_cast<const EffectSetting*>(c.effects);  // NOLINT: see above
  d.effects.count = c.effects != nullptr ? c.effect_count : 0;
  b.monitor_observer = o;
  b.monitor_observer.disturbance_cutoff_rad_s = b.monitor_observer.velocity_cutoff_rad_s =
      c.monitor_cutoff_rad_s;
  if (tool == nullptr) return;
  *tool = o;
  tool->sample_period_s = pace;
  tool->disturbance_cutoff_rad_s = tool->velocity_cutoff_rad_s = c.tool_cutoff_rad_s;
}

/// Of the spindle, 0, or of an axis, from 1 on.
inline const servosense_drive& drive_of(const servosense_config& c, std::size_t i) noexcept {
  return i == 0 ? c.spindle : c.axis[i - 1];
}

inline FrictionFollowerConfig friction_config(const servosense_config& c) noexcept {
  FrictionFollowerConfig b;
  friction_fields(c.friction, b, kToBlock);
  b.sample_period_s = c.sample_period_s;
  b.viscous = c.spindle.viscous_friction;
  b.coulomb = c.spindle.coulomb_friction;
  return b;
}

/// Everything but `grouped`, which the caller applies once this has been validated.
inline void to_blocks(const servosense_config& c, StackConfig& b) noexcept {
  all_fields(c, b, kToBlock);
  const double period = c.sample_period_s;
  const double pace = c.half_rate != 0 ? 2 * period : period;
  drive_to_block(c.spindle, period, pace, true, b.spindle, nullptr);
  b.spindle.chatter.sample_period_s = b.cut.sample_period_s = period;
  b.spindle.chatter.teeth = c.teeth;
  tell_noise(b.spindle);
  for (std::size_t i = 0; i < SERVOSENSE_AXES; ++i) {
    drive_to_block(c.axis[i], period, pace, turns(i), b.axis[i], &b.axis[i].tool_observer);
    if (turns(i)) b.axis[i].collision.standing_m_s = collision_defaults(true).standing_m_s;
    b.axis[i].collision.sample_period_s = period;
    b.axis[i].collision.friction_N = c.axis[i].coulomb_friction;
    b.axis[i].collision.cutoff_rad_s = c.axis[i].monitor_cutoff_rad_s;
  }
  // A low-pass as slow as a slow signal asks for.
  b.cut.cutoff_rad_s = std::min(b.cut.cutoff_rad_s, 0.05 / period);
  b.tool.ar_breakage.sample_period_s = b.tool.tooth_breakage.sample_period_s = period;
  b.tool.ar_breakage.teeth = b.tool.tooth_breakage.teeth = c.teeth;
  b.tool.drill_fracture.sample_period_s = b.tool.wear.sample_period_s = pace;
  b.tool.drill_fracture.rotation =
      c.drill_fracture.counter_clockwise != 0 ? Rotation::counter_clockwise : Rotation::clockwise;
  b.tool.torque_band_advance = pace;
}

inline CuttingCoefficientsConfig to_coefficients(const servosense_config& c) noexcept {
  CuttingCoefficientsConfig b;
  all_coefficients(c.coefficients, b, kToBlock);
  b.turns.sample_period_s = c.sample_period_s;
  b.turns.teeth = c.teeth;
  return b;
}

}  // namespace servosense::capi
