// At which frequency does the structure swing while the tool chatters?
//
// From the cutting torque and the spindle angle of a stretch of chatter:
//   1. Whatever repeats with the spindle is taken away by least squares on the angle: all harmonics
//      of the rotation below half the sample rate; those of the teeth above it, up to 12 kHz, where
//      their aliases come to lie; and, where the current is renewed less often than the angle, all
//      harmonics once more as they look when they are held from one update to the next, with every
//      image about the update rate in it.
//   2. A line stands out when it exceeds the noise about it (median of 64 resolutions) by a factor
//      that noise alone reaches in one stretch of 500. Amplitudes are those before the two
//      first-order lags of the observer.
//   3. Torque of an interrupted cut is p(t) u(t): u swings at f, p repeats with the teeth. So it
//      has lines at f + k tooth frequencies, and the mean frequency of their power lies within one
//      rotation frequency of f: a tooth in the cut sees u along its own direction, whose phase
//      turns by the angle of the spindle at most (the sense in which cutting feeds energy puts it
//      above f by about half of that). With three teeth or more one line is within reach of it;
//      with two there are two, and only a known natural frequency decides. Where natural
//      frequencies are known, a line more than a tenth beside all of them is not told.
//   4. Chatter that throws the teeth out of the cut has overtones: combs at 2 f, 3 f, 4 f. The comb
//      that explains most of the rest as its overtones is the first.
// Nothing is said when a comb lies at a harmonic, when it holds less than half of what stands out
// or three tenths of what does not repeat, or when the mean is not clearly nearest to one line (a
// fifth of a tooth frequency).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace servosense {

struct ChatterLineConfig {
  double sample_period_s = 125e-6;
  unsigned teeth = 0;                   ///< 0: not known, and no frequency is told
  double disturbance_cutoff_rad_s = 0;  ///< lags of the observer; 0: none
  double velocity_cutoff_rad_s = 0;
  std::vector<double> natural_frequencies_hz;  ///< of the structure, if known
};

enum class ChatterLineVerdict {
  told,
  silent,     ///< no line stands out, or none holds enough of what does not repeat
  forced,     ///< the strongest lies at a harmonic of the rotation, or next to one of the teeth
  undecided,  ///< which of the lines a tooth frequency apart cannot be said
};

struct ChatterLine {
  ChatterLineVerdict verdict = ChatterLineVerdict::silent;
  double frequency_hz = 0;            ///< at which the structure swings, when told
  double line_hz = 0;                 ///< of the strongest line, unless silent
  double standard_error_hz = 0;       ///< of the line's place
  double amplitude_Nm = 0;            ///< of the strongest line, before the observer
  double waves_per_tooth = 0;         ///< frequency over tooth passing frequency
  double spindle_speed_rpm = 0;       ///< mean over the samples
  std::vector<double> candidates_hz;  ///< one when told, two when undecided between two
};

/// Torque [Nm], spindle angle [rad, within the turn or counted on] and whether the current was new
/// at each sample (empty: at all), equally long and equally spaced. `silent` when there are fewer
/// than 256 samples or eight revolutions, or a number is not finite.
[[nodiscard]] ChatterLine chatter_line(std::span<const double> torque_Nm,
                                       std::span<const double> angle_rad,
                                       std::span<const char> renewed,
                                       const ChatterLineConfig& config);

/// The same of a line that the chatter monitor has heard and such a stretch does not show: `told`
/// where one natural frequency alone decides which of the lines a tooth frequency apart it is, else
/// `undecided`.
[[nodiscard]] ChatterLine chatter_line_at(double line_hz, double standard_error_hz,
                                          double spindle_speed_rpm,
                                          const ChatterLineConfig& config);

}  // namespace servosense
