// A feed drive or spindle under cascade control, as the blind cases see it: two masses with a
// spring and damper between motor and stage, bristle or Maxwell-slip friction at both, current
// loop, quantised encoder. Written from the mechanics alone; shares nothing with the library.
//
// Units: position m or rad, effort N or Nm. Effort at the stage, motor reflected.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace blind {

/// What the machine is, apart from any hidden effect.
struct Plant {
  double inertia = 150;
  double motor_share = 0.4;  ///< of the inertia, before the spring
  double mode_hz = 400;      ///< of the free pair
  double mode_damping = 0.03;
  double viscous = 500;
  double coulomb = 100;
  double knee = 2e-6;  ///< presliding travel
  double friction_motor_share = 0.6;
  bool maxwell_slip = false;  ///< four elements instead of a bristle
  double turn = 0.01;         ///< travel of one motor turn (2 pi for a spindle)
  double effort_per_A = 300;
  double current_loop_hz = 1000;
  double lsb = 1e-7;  ///< encoder step
  double current_noise_A = 0.003;
  double servo_hz = 4000;
  double position_gain = 30;   ///< 1/s
  double velocity_gain = 100;  ///< A s/m
  double integral_rate = 30;   ///< 1/Ti, 1/s
  double current_limit_A = 100;
};

struct Line {
  double order = 1;
  double amplitude = 0;
  double phase = 0;
};

/// What may be hidden. Zero means absent.
struct Hidden {
  double stribeck_extra = 0, stribeck_speed = 1;
  double viscous_difference = 0, coulomb_difference = 0;
  double presliding_breakaway = 0, presliding_stiffness = 1;
  double drag = 0;
  double friction_slope = 0, friction_centre = 0;           ///< per m, about a place
  double tight_spot = 0, tight_place = 0, tight_width = 1;  ///< Gaussian
  double drift_change = 0, drift_time_s = 1;
  double constant_load = 0;
  double spring = 0, spring_rest = 0;
  std::vector<Line> ripple;  ///< per motor turn
  double load_friction = 0;
  double backlash = 0;
  double flexible_hz = 0, flexible_damping = 0.03, flexible_share = 0.5;
  double flexible_friction = 0;  ///< share of the friction that is behind the coupling
  double delay_s = 0;
  double lag_hz = 0;
  double eccentricity = 0, eccentricity_phase = 0;  ///< position units
  std::vector<Line> lead;                           ///< scale minus motor, position units
  double lead_slope = 0;
  double cross_talk = 0;  ///< of the other axis's effort
  // Not in the catalogue.
  double bump = 0, bump_speed = 1;
  double vibration = 0, vibration_hz = 1, vibration_phase = 0;
  double stick = 0, stick_rate_hz = 0.5;
  double leak = 0, leak_time_s = 20, leak_zero = 0;
  double bursts_A = 0, burst_rate_hz = 0.5;
  double unseen_axis = 0;
  double load_step = 0, load_step_mean = 0;  ///< a load of two values, so far apart
  double load_step_s = 2;                    ///< that it stays at one
};

/// What a run leaves behind, at the rate of the written trace.
struct Recording {
  double rate_hz = 0;
  std::vector<double> time_s, command, motor, scale, current_A;  ///< as measured
  std::vector<std::int64_t> counts;                              ///< motor encoder
  std::vector<double> clean_motor, clean_current_A;              ///< before noise and rounding
  bool stable = true;
};

/// Runs the drive along `command` (one value a servo period). `other_effort` is that of the other
/// axis, or empty. `thin` servo periods make one row. Noise comes from `seed` alone, so that
/// runs with and without an effect see the same.
Recording run(const Plant&, const Hidden&, const std::vector<double>& command,
              const std::vector<double>& other_effort, std::size_t thin, std::uint64_t seed);

/// Energy of the free two-mass pair after `seconds` over that at the start: 1 without damping.
double free_energy_ratio(const Plant&, double seconds);

}  // namespace blind
