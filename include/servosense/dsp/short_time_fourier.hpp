// Short-time Fourier transform: power over time and frequency of a whole record (offline).
//
// Windows of `window` samples, `hop` apart, padded with zeros to `lines` points. Scaled as
// dsp/power_spectrum.hpp: the lines of a frame sum to A^2/2 for a sinusoid of amplitude A, to the
// variance for noise. A frame belongs to the middle of its window. Frequency resolution is about
// rate / window whatever the padding, which only puts lines between; a sinusoid that changes its
// frequency by more than that within a window is smeared.
// A frame that holds a sample that is not finite is NaN throughout.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"

namespace servosense {

enum class WindowShape { rectangular, hann, hamming, blackman };

/// What is taken from each window before it is tapered.
enum class Detrend { none, mean, line };

struct ShortTimeFourierConfig {
  std::size_t window = 512;  ///< samples, 4 or more (512: Koike 2016, 2.3.1)
  std::size_t hop = 128;     ///< samples from one frame to the next, 1 or more
  std::size_t lines = 0;     ///< points of the transform, at least `window`; 0: as many
  WindowShape shape = WindowShape::hann;
  Detrend detrend = Detrend::mean;
};

/// Power, frame after frame.
struct Spectrogram {
  std::vector<double> t_s;           ///< middle of each frame, from the first sample
  std::vector<double> frequency_hz;  ///< 0 .. half the sample rate
  std::vector<double> power;         ///< mean square per line, in the square of the sample's unit
  /// Sum of squares of the window times the points of the transform over the square of its sum:
  /// turns the highest line of a lone sinusoid into its mean square.
  double peak_to_mean_square = 1;

  [[nodiscard]] std::size_t frames() const { return t_s.size(); }
  [[nodiscard]] std::size_t lines() const { return frequency_hz.size(); }
  [[nodiscard]] double at(std::size_t frame, std::size_t line) const {
    return power[frame * lines() + line];
  }
  [[nodiscard]] std::span<const double> frame(std::size_t i) const {
    return std::span(power).subspan(i * lines(), lines());
  }
};

/// The window, periodic (its next value would be the first again), highest value 1.
[[nodiscard]] std::vector<double> window_of(WindowShape shape, std::size_t samples);

/// Errors: a record shorter than the window, a rate that is not positive, a configuration out of
/// range.
[[nodiscard]] Expected<Spectrogram> short_time_fourier(std::span<const double> samples,
                                                       double sample_rate_hz,
                                                       const ShortTimeFourierConfig& config = {});

}  // namespace servosense
