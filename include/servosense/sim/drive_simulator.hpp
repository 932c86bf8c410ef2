// Drive simulator: a servo drive under cascade control, with the drive model of the observer as its
// plant.
//
//   reference -> P (position) -> PI (velocity) -> limit -> delay -> current loop -> effort
//   J v' = effort - resistance(x, v) - D v - cutting,   x' = v
//   encoder counts <- x + position error of the effects
//
// Plant. One mass (Koike 2016, eq. 2-18), or two when the model contains `flexible-coupling` or
// `backlash` (eq. 2-12 to 2-14); the cutting force then acts on the load. Friction and effects are
// model/drive_model.hpp, the same members that the observer calls.
//
// Controller, at the servo rate, on the encoder reading x_n:
//   v_n = (x_n - x_{n-1}) / T
//   e_n = position_gain (r_n - x_n) - v_n        position loop;  e_n = r_n - v_n   velocity loop
//   s_n = s_{n-1} + gain integral T e_n,   i_n = gain e_n + s_n, limited
// The integrator stands still while the current is limited and e_n pushes further out. A real drive
// filters and feeds forward more than that.
//
// Integration. Steps of T/substeps: half a step at constant velocity, a step of velocity under the
// forces there (viscous friction by the implicit midpoint, other velocity terms at the extrapolated
// midpoint), half a step at constant velocity. The friction's elastoplastic sign is driven by the
// path from midpoint to midpoint, so stiction is a spring and never chatters. The current loop is
// exact. Second order in the step (first in the damping of a flank of `backlash`); time-reversible
// without damping, so a free oscillation neither grows nor decays.
//
// Starts at rest in equilibrium: integrator and current carry the load that is there.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/model/drive_model.hpp"
#include "servosense/sim/gaussian_noise.hpp"

namespace servosense {

/// What the reference of DriveSimulator::step is.
enum class DriveLoop : unsigned char { position, velocity };

/// Which current a trace shows.
enum class ReportedCurrent : unsigned char {
  actual,     ///< behind delay and current loop of the controller
  reference,  ///< what the controller asks for
};

/// Cascade controller; the keys of [controller.*]. Gains per metre or per rad, at the stage.
struct CascadeConfig {
  double position_gain_per_s = 0;  ///< used by the position loop
  double velocity_gain_A_s = 0;    ///< A per m/s or per rad/s
  double velocity_integral_per_s = 0;
  double current_limit_A = 1e9;
  double current_bandwidth_hz = 0;  ///< 0: the current follows at once
  double delay_s = 0;
};

struct SimulatedEncoderConfig {
  double counts_per_turn = 0;  ///< 0: position is read exactly, and no counts are given
  unsigned counter_bits = 32;
  std::int64_t initial_counts = 0;  ///< reading at position 0; the turn angle follows it
};

/// A line fixed in time, not in angle: a pump, the foundation. Not part of the drive's model, so no
/// observer knows it.
struct TimeLockedVibration {
  double frequency_hz = 0;
  double amplitude = 0;  ///< N or Nm
  double phase_rad = 0;
};

/// Units: m, N, kg for an axis; rad, Nm, kg m2 for a spindle.
struct DriveSimulatorConfig {
  DriveLoop loop = DriveLoop::position;
  double sample_period_s = 125e-6;
  /// effects.sample_period_s is ignored; unit_per_turn is needed for counts.
  DriveModelConfig drive;
  double effort_per_A = 1;  ///< N/A at the stage, or Nm/A
  CascadeConfig controller;
  SimulatedEncoderConfig encoder;
  double initial_position = 0;   ///< m or rad
  double current_update_hz = 0;  ///< of the reported current; 0: the servo rate
  ReportedCurrent reported = ReportedCurrent::actual;
  double current_noise_A = 0;  ///< rms of white noise on each reported value
  std::uint64_t seed = 1;
  std::vector<TimeLockedVibration> vibrations;
  unsigned substeps = 0;  ///< integration steps per sample; 0: as many as the stiffest part needs
};

/// One servo instant. Trace columns: `angle_counts`, `current_A` (empty unless current_is_new),
/// `command_position_m` or a spindle's speed.
struct DriveSimSample {
  double t_s = 0;
  std::int64_t angle_counts = 0;  ///< counter reading, 0 .. 2^counter_bits - 1 (64 bits: signed)
  double reference = 0;
  double current_A = 0;  ///< as reported
  bool current_is_new = true;

  // What no drive reports: the truth at this instant...
  double position = 0;  ///< motor side
  double velocity = 0;
  double load_position = 0;  ///< to within half a step
  // ...and means until the next one. effort = J dv/dt + resistance (+ cutting with one mass).
  double effort = 0;
  double resistance = 0;  ///< friction, loads, effects, vibrations
  double cutting = 0;
};

class DriveSimulator {
 public:
  using Config = DriveSimulatorConfig;

  /// Usage error naming what is wrong.
  static Expected<DriveSimulator> create(const Config& config);

  /// The state at this servo instant, then on to the next. `reference` in m or rad for the position
  /// loop, m/s or rad/s for the velocity loop; `cutting` [N or Nm] opposes positive motion and is
  /// held until the next instant. A number that is not finite repeats the last one.
  DriveSimSample step(double reference, double cutting = 0);
  /// From the next step on, force or torque per ampere over `effort_per_A`: that of a warm motor.
  void set_constant_ratio(double ratio) { constant_ratio_ = ratio; }

  /// Steps over `duration_s`, with reference and cutting force as functions of time.
  std::vector<DriveSimSample> run(double duration_s, const std::function<double(double)>& reference,
                                  const std::function<double(double)>& cutting = {});

  [[nodiscard]] unsigned substeps() const { return substeps_; }
  [[nodiscard]] const Config& config() const { return config_; }

 private:
  explicit DriveSimulator(const Config& config, unsigned substeps);
  [[nodiscard]] std::int64_t read_encoder(double& measured);
  [[nodiscard]] double control(double reference, double measured);
  void send(double reference_A);
  void report_current(DriveSimSample& sample, double reference_A);
  void integrate(DriveSimSample& sample);
  void advance_turn(double increment);

  Config config_;
  unsigned substeps_;
  DriveModel<double> model_;
  GaussianNoise noise_;

  // Constants.
  double step_s_ = 0;
  double constant_ratio_ = 1;
  double unit_per_count_ = 0;
  double rad_per_unit_ = 0;
  double current_stays_ = 0;  // share of a current error left after a step, and its mean over it
  double current_mean_ = 0;
  double switch_step_ = 0;  // within a period, where a delayed reference arrives

  // State.
  std::uint64_t sample_ = 0;
  double position_ = 0;
  double velocity_ = 0;
  double acceleration_ = 0;
  MotionState<double> motion_;  // at the middle of the last step
  double last_measured_ = 0;
  double integral_A_ = 0;
  double current_A_ = 0;         // actual
  std::vector<double> delay_A_;  // references on their way, a ring
  std::size_t oldest_ = 0;
  double earlier_A_ = 0, later_A_ = 0;  // references before and after switch_step_
  double reported_A_ = 0;
  double last_reference_ = 0;
  double last_cutting_ = 0;  // good ones
  double held_cutting_ = 0;  // of the last period
};

}  // namespace servosense
