// Which field of the C configuration is which of the blocks': one table for the defaults, the way
// to the blocks, the way back from a machine file, and what is printed for flash.
//
// visit(name, field of C, field of the block), for every field that both call by the same name.
// What is not here is worked out by config_translation.hpp: drives, periods, teeth, references.
#pragma once

#include <type_traits>

#include "servosense/capi/servosense.h"
#include "servosense/monitors/cutting_coefficients_config.hpp"
#include "servosense/monitors/friction_follower.hpp"
#include "servosense/monitors/monitor_stack_config.hpp"

namespace servosense::capi {

#define SERVOSENSE_FIELD(name) visit(#name, c.name, b.name)

template <typename C, typename B, typename Visit>
void signal_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(enabled);
  SERVOSENSE_FIELD(effort_limit);
  SERVOSENSE_FIELD(saturated_samples);
  SERVOSENSE_FIELD(frozen_samples);
  SERVOSENSE_FIELD(tolerated_share);
  SERVOSENSE_FIELD(window_samples);
  SERVOSENSE_FIELD(release_samples);
}

template <typename C, typename B, typename Visit>
void chatter_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(chatter_threshold_Nm2);
  SERVOSENSE_FIELD(forced_threshold_Nm2);
  SERVOSENSE_FIELD(window_revolutions);
  SERVOSENSE_FIELD(harmonics);
  SERVOSENSE_FIELD(consecutive_revolutions);
  SERVOSENSE_FIELD(release_revolutions);
  SERVOSENSE_FIELD(minimum_speed_rad_s);
  SERVOSENSE_FIELD(warning_fraction);
  SERVOSENSE_FIELD(release_fraction);
  SERVOSENSE_FIELD(tolerated_stand_ins);
  SERVOSENSE_FIELD(tolerated_load_share);
  SERVOSENSE_FIELD(cutting_torque_Nm);
  visit("line_threshold", c.line_threshold, b.lines.threshold);
}

template <typename C, typename B, typename Visit>
void collision_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(threshold_N_per_s);
  SERVOSENSE_FIELD(phase_threshold_N_per_s);
  SERVOSENSE_FIELD(cutting_threshold_N_per_s);
  SERVOSENSE_FIELD(mean_N_per_s);
  SERVOSENSE_FIELD(accelerating_m_s2);
  SERVOSENSE_FIELD(maximum_feed_m_s);
  SERVOSENSE_FIELD(wait_s);
  SERVOSENSE_FIELD(tool_radius_m);
  SERVOSENSE_FIELD(notch_hz);
  SERVOSENSE_FIELD(notch_quality);
  SERVOSENSE_FIELD(resonance_hz);
  SERVOSENSE_FIELD(resonance_quality);
  SERVOSENSE_FIELD(warning_fraction);
  SERVOSENSE_FIELD(release_fraction);
  SERVOSENSE_FIELD(consecutive_samples);
  SERVOSENSE_FIELD(release_samples);
}

template <typename C, typename B, typename Visit>
void cut_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(torque_Nm);
  SERVOSENSE_FIELD(cutoff_rad_s);
  SERVOSENSE_FIELD(minimum_speed_rad_s);
  SERVOSENSE_FIELD(hold_s);
  SERVOSENSE_FIELD(unseen);
  SERVOSENSE_FIELD(load_cutoff_rad_s);
  SERVOSENSE_FIELD(load_hold_s);
}

template <typename C, typename B, typename Visit>
void friction_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(share);
  SERVOSENSE_FIELD(cutting_torque_Nm);
  SERVOSENSE_FIELD(minimum_speed_rad_s);
  SERVOSENSE_FIELD(window_s);
}

template <typename C, typename B, typename Visit>
void ar_breakage_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(noise_Nm);
  SERVOSENSE_FIELD(minimum_speed_rad_s);
  SERVOSENSE_FIELD(order_revolutions);
  SERVOSENSE_FIELD(memory_revolutions);
  SERVOSENSE_FIELD(residual_window);
  SERVOSENSE_FIELD(residual_ratio);
  SERVOSENSE_FIELD(repetition_limit);
  SERVOSENSE_FIELD(steadiness_limit);
  SERVOSENSE_FIELD(share_threshold);
  SERVOSENSE_FIELD(warning_fraction);
  SERVOSENSE_FIELD(release_fraction);
  SERVOSENSE_FIELD(release_revolutions);
  SERVOSENSE_FIELD(stages_per_sample);
}

template <typename C, typename B, typename Visit>
void tooth_breakage_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(torque);
  SERVOSENSE_FIELD(noise);
  SERVOSENSE_FIELD(sample_noise);
  SERVOSENSE_FIELD(minimum_speed_rad_s);
  SERVOSENSE_FIELD(tolerated_throw);
  SERVOSENSE_FIELD(swept_angle_rad);
  SERVOSENSE_FIELD(new_fraction);
  SERVOSENSE_FIELD(noise_factor);
  SERVOSENSE_FIELD(memory_s);
  SERVOSENSE_FIELD(threshold);
  SERVOSENSE_FIELD(warning_fraction);
  SERVOSENSE_FIELD(release_fraction);
  SERVOSENSE_FIELD(release_revolutions);
  SERVOSENSE_FIELD(consecutive_revolutions);
}

template <typename C, typename B, typename Visit>
void drill_fracture_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(threshold_N);
  SERVOSENSE_FIELD(drilling_thrust_N);
  SERVOSENSE_FIELD(window_samples);
  SERVOSENSE_FIELD(minimum_speed_rad_s);
  SERVOSENSE_FIELD(entry_s);
  SERVOSENSE_FIELD(average_s);
  SERVOSENSE_FIELD(warning_fraction);
  SERVOSENSE_FIELD(release_fraction);
  SERVOSENSE_FIELD(release_verdicts);
  SERVOSENSE_FIELD(consecutive_verdicts);
  SERVOSENSE_FIELD(tolerated_stand_ins);
}

template <typename C, typename B, typename Visit>
void wear_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(part_s);
  SERVOSENSE_FIELD(feed_direction);
  SERVOSENSE_FIELD(cutting_thrust_N);
  SERVOSENSE_FIELD(cutting_torque_Nm);
  SERVOSENSE_FIELD(release_fraction);
  SERVOSENSE_FIELD(maximum_feed_m_s);
  SERVOSENSE_FIELD(minimum_speed_rad_s);
  SERVOSENSE_FIELD(steady_fraction);
  SERVOSENSE_FIELD(equivalent_mass_kg);
  SERVOSENSE_FIELD(inertia_kg_m2);
  SERVOSENSE_FIELD(entry_m);
  SERVOSENSE_FIELD(exit_m);
  SERVOSENSE_FIELD(shortest_m);
  SERVOSENSE_FIELD(clearance_m);
  SERVOSENSE_FIELD(peck_window_s);
  SERVOSENSE_FIELD(thrust_limit_N);
  SERVOSENSE_FIELD(thrust_step_N);
  SERVOSENSE_FIELD(thrust_ratio);
  SERVOSENSE_FIELD(torque_limit_Nm);
  SERVOSENSE_FIELD(torque_step_Nm);
  SERVOSENSE_FIELD(torque_ratio);
  SERVOSENSE_FIELD(specific_force_ratio);
  SERVOSENSE_FIELD(warning_fraction);
  SERVOSENSE_FIELD(teach_holes);
  SERVOSENSE_FIELD(average_holes);
  SERVOSENSE_FIELD(confirm_holes);
  SERVOSENSE_FIELD(friction_error_N);
  SERVOSENSE_FIELD(friction_drift_N);
  SERVOSENSE_FIELD(friction_noise_N);
  SERVOSENSE_FIELD(rapid_m_s);
  SERVOSENSE_FIELD(spindle_error_Nm);
  SERVOSENSE_FIELD(spindle_drift_Nm);
  SERVOSENSE_FIELD(spindle_noise_Nm);
  SERVOSENSE_FIELD(top_speed_rad_s);
  SERVOSENSE_FIELD(tolerated_stand_ins);
}

template <typename C, typename B, typename Visit>
void torque_band_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(spacing);
  SERVOSENSE_FIELD(step);
  SERVOSENSE_FIELD(max_shift);
  SERVOSENSE_FIELD(shift_step);
  SERVOSENSE_FIELD(sync_shift);
  SERVOSENSE_FIELD(max_drift);
  SERVOSENSE_FIELD(memory_steps);
  SERVOSENSE_FIELD(alarm_steps);
  SERVOSENSE_FIELD(warning_fraction);
  SERVOSENSE_FIELD(release_fraction);
  SERVOSENSE_FIELD(release_steps);
  SERVOSENSE_FIELD(air_limit_Nm);
  SERVOSENSE_FIELD(steady_share);
  SERVOSENSE_FIELD(over_path);
  SERVOSENSE_FIELD(shifts_per_sample);
  SERVOSENSE_FIELD(tolerated_stand_ins);
}

template <typename C, typename B, typename Visit>
void cut_shares_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(torque_chip_m3);
  SERVOSENSE_FIELD(torque_edge_m2);
  SERVOSENSE_FIELD(x_tangential_chip_m2);
  SERVOSENSE_FIELD(x_tangential_edge_m);
  SERVOSENSE_FIELD(x_radial_chip_m2);
  SERVOSENSE_FIELD(x_radial_edge_m);
  SERVOSENSE_FIELD(y_tangential_chip_m2);
  SERVOSENSE_FIELD(y_tangential_edge_m);
  SERVOSENSE_FIELD(y_radial_chip_m2);
  SERVOSENSE_FIELD(y_radial_edge_m);
}

template <typename C, typename B, typename Visit>
void told_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(value);
  SERVOSENSE_FIELD(error);
}

/// Those of its turns.
template <typename C, typename B, typename Visit>
void cutting_turns_fields(C& c, B&& b, Visit visit) {
  SERVOSENSE_FIELD(cutting_torque_Nm);
  SERVOSENSE_FIELD(radius_m);
  SERVOSENSE_FIELD(least_feed_per_tooth_m);
  SERVOSENSE_FIELD(most_feed_per_tooth_m);
  SERVOSENSE_FIELD(minimum_speed_rad_s);
  SERVOSENSE_FIELD(settle_s);
  SERVOSENSE_FIELD(steady_feed);
  SERVOSENSE_FIELD(steady_speed);
}

/// Without its shares and what is told of the coefficients, which are structs of their own.
template <typename C, typename B, typename Visit>
void coefficients_fields(C& c, B&& b, Visit visit) {
  cutting_turns_fields(c, b.turns, visit);
  SERVOSENSE_FIELD(feed_per_tooth_m);
  SERVOSENSE_FIELD(chip_m);
  SERVOSENSE_FIELD(torque_friction_error_Nm);
  SERVOSENSE_FIELD(force_friction_error_N);
  SERVOSENSE_FIELD(friction_memory_s);
  SERVOSENSE_FIELD(drift);
  SERVOSENSE_FIELD(smallest_change);
  SERVOSENSE_FIELD(false_change_slots);
  SERVOSENSE_FIELD(teach_slots);
  SERVOSENSE_FIELD(taught_N_per_m2);
}

/// `in(name, visit)` is what visits the fields of the struct `name`.
template <typename C, typename B, typename In>
void coefficients_structs(C& c, B&& b, In in) {
  in("shares", [&](auto visit) { cut_shares_fields(c.shares, b.shares, visit); });
  in("tangential", [&](auto visit) { told_fields(c.tangential, b.tangential, visit); });
  in("tangential_edge",
     [&](auto visit) { told_fields(c.tangential_edge, b.tangential_edge, visit); });
  in("radial", [&](auto visit) { told_fields(c.radial, b.radial, visit); });
  in("radial_edge", [&](auto visit) { told_fields(c.radial_edge, b.radial_edge, visit); });
}

/// The whole of the cutting coefficients but period and teeth.
template <typename C, typename B, typename Visit>
void all_coefficients(C& c, B&& b, Visit visit) {
  coefficients_fields(c, b, visit);
  coefficients_structs(c, b, [&](const char*, auto fields) { fields(visit); });
}

#undef SERVOSENSE_FIELD

/// Visits: the block's field from C's, and C's from the block's.
inline constexpr auto kToBlock = []<typename C, typename B>(const char*, const C& c, B& b) {
  if constexpr (std::is_array_v<C>)
    for (std::size_t i = 0; i < std::extent_v<C>; ++i) b[i] = c[i];
  else
    b = static_cast<B>(c);
};
inline constexpr auto kFromBlock = []<typename C, typename B>(const char*, C& c, const B& b) {
  if constexpr (std::is_array_v<C>)
    for (std::size_t i = 0; i < std::extent_v<C>; ++i) c[i] = b[i];
  else
    c = static_cast<C>(b);
};

/// Every part that is a table alone, with `enabled` beside it.
template <typename C, typename B, typename Visit>
void all_fields(C& c, B&& b, Visit visit) {
  signal_fields(c.spindle.signal, b.spindle.signal, visit);
  visit("enabled", c.chatter.enabled, b.spindle.chatter_on);
  chatter_fields(c.chatter, b.spindle.chatter, visit);
  for (std::size_t i = 0; i < SERVOSENSE_AXES; ++i) {
    signal_fields(c.axis[i].signal, b.axis[i].signal, visit);
    visit("enabled", c.collision[i].enabled, b.axis[i].collision_on);
    collision_fields(c.collision[i], b.axis[i].collision, visit);
  }
  cut_fields(c.cut, b.cut, visit);
  visit("enabled", c.ar_breakage.enabled, b.tool.ar_breakage_on);
  ar_breakage_fields(c.ar_breakage, b.tool.ar_breakage, visit);
  visit("enabled", c.tooth_breakage.enabled, b.tool.tooth_breakage_on);
  tooth_breakage_fields(c.tooth_breakage, b.tool.tooth_breakage, visit);
  visit("enabled", c.drill_fracture.enabled, b.tool.drill_fracture_on);
  drill_fracture_fields(c.drill_fracture, b.tool.drill_fracture, visit);
  visit("enabled", c.wear.enabled, b.tool.wear_on);
  wear_fields(c.wear, b.tool.wear, visit);
  visit("enabled", c.torque_band.enabled, b.tool.torque_band_on);
  torque_band_fields(c.torque_band, b.tool.torque_band, visit);
  visit("half_rate", c.half_rate, b.tool.half_rate);
}

}  // namespace servosense::capi
