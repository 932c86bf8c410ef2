// Speed along a path over time: ramps of constant acceleration, or of constant jerk on both sides
// of one, with a stretch of constant speed between them.
//
// Trapezoid and triangle follow from v^2 = v0^2 + 2 a s. With a jerk limit j a ramp over dv takes
// dv/a + a/j, or 2 sqrt(dv/j) when it ends before the acceleration is reached, and goes the mean of
// both speeds times that (Biagiotti and Melchiorri 2008, section 3.4): acceleration is 0 at its
// ends.
#pragma once

#include <array>
#include <cstddef>
#include <limits>

namespace servosense::process {

struct RampLimits {
  double acceleration_m_s2 = 1;  ///< above 0
  double jerk_m_s3 = std::numeric_limits<double>::infinity();
};

/// What a change from one speed to the other takes [s] and goes [m].
[[nodiscard]] double ramp_seconds(double from_m_s, double to_m_s, const RampLimits& limits);
[[nodiscard]] double ramp_length(double from_m_s, double to_m_s, const RampLimits& limits);
/// Greatest speed from which `length_m` suffices to reach `end_m_s` [m/s]; as well the greatest
/// that is reached from there.
[[nodiscard]] double reachable_speed(double end_m_s, double length_m, const RampLimits& limits);

class VelocityProfile {
 public:
  struct Phase {
    double duration_s = 0;
    double velocity_m_s = 0, acceleration_m_s2 = 0;  ///< at its start
    double jerk_m_s3 = 0;
  };

  /// The shortest way over `length_m` from speed `start_m_s` to `end_m_s` without going faster than
  /// `top_m_s`. An end that is too fast to be reached becomes what is reached; a start that is too
  /// fast to be braked in time is braked as hard as the length demands.
  static VelocityProfile plan(double length_m, double start_m_s, double top_m_s, double end_m_s,
                              const RampLimits& limits);

  [[nodiscard]] double duration_s() const { return duration_s_; }
  [[nodiscard]] double length_m() const { return length_m_; }
  [[nodiscard]] double end_m_s() const;
  /// Speed at which the last ramp down begins; the end's without one.
  [[nodiscard]] double braking_from_m_s() const;
  /// Distance from the start [m], speed [m/s] and acceleration [m/s2]; times outside are taken to
  /// the nearest end.
  [[nodiscard]] double distance(double t_s) const;
  [[nodiscard]] double velocity(double t_s) const;
  [[nodiscard]] double acceleration(double t_s) const;
  /// When `distance_m` has been gone [s].
  [[nodiscard]] double time_at(double distance_m) const;

 private:
  void add(const Phase& phase);
  /// From one speed to the other as fast as the limits allow.
  void add_ramp(double from_m_s, double to_m_s, const RampLimits& limits);
  struct Place {
    const Phase* phase;
    double t_s, before_m;
  };
  [[nodiscard]] Place place(double t_s) const;

  std::array<Phase, 7> phases_{};  // two ramps of three, and a stretch between them
  std::size_t count_ = 0;
  double duration_s_ = 0, length_m_ = 0;
};

}  // namespace servosense::process
