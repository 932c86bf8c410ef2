// The second generator's machine: mechanics and electronics of a drive, written from the public
// description of the files and of the effects alone. It shares nothing with the first generator and
// nothing with the library. All figures are of the channel: metres and newtons, or radians and
// newton metres.
#pragma once

#include <cstdint>

#include "analysis.hpp"

namespace blind::second {

/// The last: Maxwell slip whose springs slip over a decade of travel, not evenly up to the last.
enum class Law { lugre, dahl, maxwell_slip, tanh, arctan, wide_slip };

/// What the drive writes down as its effort.
enum class Reports {
  command,         ///< what the controller asks for now
  command_before,  ///< what it asked for a sample ago
  measured,        ///< the current at the instant of sampling
  measured_mean,   ///< its mean over the last sample
};

enum class Outside {
  none,
  friction_bump,        ///< friction higher around one speed; a: that speed, b: width
  intermittent_stick,   ///< friction higher for a moment, at random; a: per second, b: how long
  wandering_load,       ///< a load that drifts without a rule; a: time constant
  interference_bursts,  ///< on the reported effort alone; a: per second, b: how long
  load_pulses,          ///< pushes from outside; a: per second, b: how long
  load_steps,           ///< a load of two values; a: how long it stays, b: share of the second
  narrow_band,          ///< vibration whose phase wanders; a: frequency, b: damping
  effort_dead_band,     ///< a small command does nothing
  effort_saturation,  ///< the motor gives less where more is asked; a: effort where `size` is lost
  vibration,          ///< a line fixed in time; a: frequency, b: phase
};

struct Plant {
  double inertia = 50;      ///< all that moves
  double load_share = 0.6;  ///< of it behind the coupling
  bool rigid = false;       ///< nothing bends
  double mode_hz = 400;     ///< resonance of the free pair
  double mode_damping = 0.03;
  double coulomb = 50, viscous = 200;
  double load_friction = 0.5;  ///< share of the friction that acts on the load
  Law law = Law::lugre;
  double presliding = 2e-6;      ///< friction level over bristle stiffness
  double bristle_damping = 0.3;  ///< LuGre: of the bristle with the load's mass, a ratio
  double creep_speed = 2e-4;     ///< of the laws without a bristle
  double turn = 0.01;            ///< travel of a turn of the motor

  double servo_hz = 2000;
  double step_s = 25e-6;  ///< largest step of the integration
  bool runge_kutta = true;
  double position_gain = 30, velocity_gain = 6000, integral_per_s = 20, limit = 2000;
  double feed_forward = 0;     ///< share of speed and inertia that is fed forward
  double current_loop_hz = 0;  ///< 0: at once
  double dead_time_s = 0;

  Reports reports = Reports::command;
  double encoder_step = 1e-7, scale_step = 1e-7, effort_step = 0.01;
  double effort_noise = 0.5;  ///< of the report
  double force_noise = 0.5;   ///< that acts, held for a sample
};

struct Hidden {
  double extra_static = 0, stribeck_speed = 1;
  double viscous_difference = 0, coulomb_difference = 0;  ///< forward minus backward
  double slow_breakaway = 0, slow_travel = 1;             ///< a second bristle beside the friction
  double quadratic = 0;
  double tight_force = 0, tight_at = 0, tight_width = 1, friction_slope = 0, slope_from = 0;
  double thermal_change = 0, thermal_s = 1;
  double load = 0, spring = 0, spring_rest = 0;
  double ripple = 0, ripple_order = 1, ripple_phase = 0;
  double play = 0;
  double late_s = 0;
  bool late_reading = false;  ///< the report is late, not the action
  double lag_hz = 0;
  double eccentricity = 0, eccentricity_phase = 0;  ///< [rad of the motor]
  double load_coefficient = 0;
  double cross_coefficient = 0;  ///< times the acceleration of the other axis
  double lead_amplitude = 0, lead_phase = 0, lead_slope = 0;
  Outside outside = Outside::none;
  double outside_size = 0, outside_a = 1, outside_b = 1;
};

struct Record {
  Signal position, scale, effort;       ///< as written down
  Signal motor, load, actual;           ///< as it was; `actual`: what the motor gave
  Signal position_error, effort_error;  ///< of reading, and the noise that acts
  bool stable = true;
};

/// Follows `reference`, one value a sample. `other` is the acceleration of another axis or empty.
Record simulate(const Plant&, const Hidden&, const Signal& reference, const Signal& other,
                std::uint64_t seed);

/// Stiffness of the coupling whose free resonance is the plant's.
double coupling_stiffness(const Plant&);

}  // namespace blind::second
