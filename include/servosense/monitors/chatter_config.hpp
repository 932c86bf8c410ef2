// What the chatter monitor (chatter.hpp) is set to, and how long a window it needs.
#pragma once

#include <cmath>
#include <cstdint>

#include "servosense/core/units.hpp"

namespace servosense {

/// How often lines are looked for: every 128 parts of a revolution, of 2.4 samples.
[[nodiscard]] inline double line_transforms_per_hour(double sample_period_s) noexcept {
  return 3600 / (128 * 2.4 * sample_period_s);
}

/// Over the threshold of noise, for what a cut has besides: the largest score of 697 stable cuts is
/// 1.7 of it (docs/chatter-lines.md).
inline constexpr double kLineMargin = 1.8;

/// Score that the noise of a cut exceeds so often: scores are exponential with mean one, 256 of
/// them a transform; that windows overlap is left out, on the safe side.
[[nodiscard]] inline double chatter_line_threshold(double sample_period_s,
                                                   double false_alarms_per_hour) noexcept {
  return std::log(256 * line_transforms_per_hour(sample_period_s) / false_alarms_per_hour);
}

/// One false alarm in a hundred hours of cutting.
[[nodiscard]] inline double usual_chatter_line_threshold(double sample_period_s) noexcept {
  constexpr double kPerHour = 0.01;
  return kLineMargin * chatter_line_threshold(sample_period_s, kPerHour);
}

/// What the noise is that lines stand in: that of a drive, whose law is known, or of a sensor,
/// whose floor is what lies beside a line (sensor_chatter.hpp).
enum class ChatterNoise : std::uint8_t { drive, sensor };

/// What is heard as a narrow line (chatter_lines.hpp): nothing until the noise is known
/// (tell_noise, chatter_noise.hpp).
struct ChatterLinesConfig {
  double threshold = usual_chatter_line_threshold(125e-6);  ///< of the score; 0: no lines
  double inertia_kg_m2 = 0;                                 ///< 0: the noise is not known
  double counts_per_turn = 0;  ///< of the encoder; 0: the motion does not come from a counter
  double disturbance_cutoff_rad_s = 3500;  ///< of the observer that is heard
  double velocity_cutoff_rad_s = 3500;
};

struct ChatterConfig {
  double sample_period_s = 125e-6;
  unsigned window_revolutions = 8;       ///< R: resolution is the rotation frequency / R
  unsigned harmonics = 10;               ///< H: multiples of the rotation that count as forced
  unsigned teeth = 0;                    ///< of the tool; 0 = unknown
  double minimum_speed_rad_s = 100;      ///< slower than this the monitor idles
  double chatter_threshold_Nm2 = 0;      ///< 0 = no chatter alarm
  double forced_threshold_Nm2 = 0;       ///< 0 = no alarm for forced vibration
  double warning_fraction = 0.75;        ///< of the threshold
  double release_fraction = 0.5;         ///< of the threshold
  unsigned release_revolutions = 8;      ///< below the release level before an alarm ends
  unsigned consecutive_revolutions = 1;  ///< at or above a level before it is raised
  double tolerated_stand_ins = 0.01;     ///< part of the window that may be replaced samples
  double tolerated_load_share =
      0.001;  ///< of the load (mean square of the torque): chatter so small is none
  double cutting_torque_Nm = 0;  ///< mean of a revolution that means cutting; 0 = not known
  ChatterLinesConfig lines;
};

/// What a window is chosen from.
struct ChatterWindowChoice {
  double sample_period_s = 125e-6;
  double slowest_rad_s = 100;  ///< slowest speed that is cut at
  unsigned teeth = 0;          ///< 0 = unknown
  unsigned harmonics = 10;
  double resolution = 0.125;  ///< wanted, as a part of the rotation frequency
  double latency_s = 1;       ///< at most, from chatter to alarm, at the slowest speed
  unsigned consecutive_revolutions = 2;
  unsigned most = 8;  ///< capacity
};

/// R for these needs. Lines apart by less than 1/R of the rotation frequency are one. The ends of
/// the window leak (h step)^2 / (5 W) of a forced line into the residue: kept below 1 % for the
/// highest tooth harmonic that is watched (of the rotation, teeth unknown) or half the sample rate.
/// A forced alarm waits R + consecutive_revolutions at most: where that is too long latency wins.
/// Never below 3, what the comb looks back on. All at the slowest speed, where a revolution takes
/// longest; the leak grows with the third power of the speed.
[[nodiscard]] constexpr unsigned chatter_window_revolutions(const ChatterWindowChoice& c) noexcept {
  const auto up = [](double x) {
    return x < 1000 ? static_cast<unsigned>(x) + (x > static_cast<unsigned>(x) ? 1U : 0U) : 1000U;
  };
  const double step = c.slowest_rad_s * c.sample_period_s;
  const unsigned teeth = c.teeth > 0 && c.teeth <= c.harmonics ? c.teeth : 1;
  const unsigned highest = c.harmonics - c.harmonics % teeth;
  const double turn = highest * step < kPi ? highest * step : kPi;
  const unsigned for_lines = up(1 / c.resolution);
  const unsigned for_leak = up(turn * turn / (5 * 0.01) * step / kTwoPi);
  const unsigned wanted = for_lines > for_leak ? for_lines : for_leak;
  const double turns = c.latency_s * c.slowest_rad_s / kTwoPi - c.consecutive_revolutions;
  const unsigned allowed = turns > 3 ? (turns < 1000 ? static_cast<unsigned>(turns) : 1000U) : 3U;
  const unsigned least = wanted < allowed ? wanted : allowed;
  return least < 3 ? 3 : least < c.most ? least : c.most;
}

}  // namespace servosense
