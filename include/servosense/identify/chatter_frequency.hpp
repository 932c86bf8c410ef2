// At which frequency does it chatter, and at which speeds would it chatter less?
//
// From the torque samples of a chatter alarm (its evidence): the harmonics of the rotation are
// removed by least squares on the spindle angle, the rest is transformed (Hann window), and the
// strongest line is placed between the bins by the ratio r of the higher to the lower of its two
// largest magnitudes: offset (2 r - 1) / (r + 1), exact for a line alone.
//
// An interrupted cut shows chatter at f and at f + k tooth frequencies, k = ..., -1, 0, 1, ...: one
// line cannot say which of them the structure swings at. Lines are compared as they were before
// the observer's two first-order lags; a known natural frequency settles it.
//
// Speeds: chatter is weakest where the structure swings a whole number of times from tooth to
// tooth, n = f / (teeth k) (Koike 2016, ch. 8; exact for the natural frequency, which lies a few
// per cent below that of chatter).
#pragma once

#include <optional>
#include <span>
#include <vector>

namespace servosense {

struct ChatterLineConfig {
  double sample_period_s = 125e-6;
  unsigned harmonics = 10;              ///< of the rotation, removed first
  unsigned teeth = 0;                   ///< 0: not known
  double disturbance_cutoff_rad_s = 0;  ///< lags of the observer; 0: none
  double velocity_cutoff_rad_s = 0;
  std::vector<double> natural_frequencies_hz;  ///< of the structure, if known
};

struct ChatterLine {
  double frequency_hz = 0;       ///< at which the structure swings, as far as can be said
  double seen_hz = 0;            ///< strongest line of the torque
  double amplitude_Nm = 0;       ///< of that line
  double share = 0;              ///< of the power beside the harmonics, 0..1
  double spindle_speed_rpm = 0;  ///< mean over the samples
};

/// Torque [Nm] and spindle angle [rad, within the turn or counted on], equally long and equally
/// spaced. Nothing when there are fewer than 64 samples or four a harmonic, a number is not finite,
/// or no line stands out (8 dB above the mean of all lines).
[[nodiscard]] std::optional<ChatterLine> chatter_line(std::span<const double> torque_Nm,
                                                      std::span<const double> angle_rad,
                                                      const ChatterLineConfig& config);

/// Spindle speeds [rpm] from..to, rising, at which `frequency_hz` is a whole multiple of the tooth
/// passing frequency. Empty without teeth or frequency.
[[nodiscard]] std::vector<double> quiet_speeds_rpm(double frequency_hz, unsigned teeth,
                                                   double from_rpm, double to_rpm);

}  // namespace servosense
