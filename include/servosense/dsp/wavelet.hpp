// Continuous wavelet transform of a record (offline).
//
// Purpose: amplitude over time at chosen frequencies, with a window that grows shorter as the
// frequency grows; what the rotational filter is held against (Koike 2016, sec. 2.3.2 and ch. 6).
// Equation: X(f, t) = 2 / sum w * sum over n of x(t + n) w(n) e^(-j 2 pi f n / Fs), w as long as
// `cycles` periods of f and centred on t (Koike 2016, eq. 2-43). Scaled so that a sinusoid of
// amplitude A at f gives |X| = A; the source's factor alpha^(-1/2), which weighs frequencies
// against each other, is left out.
// Method: products of spectra over a zero-padded record (Eigen FFT), so nothing wraps around.
// Where the window reaches beyond the record, zeros count: `reach` samples at either end.
// Bad at: one signal at a time. sqrt(|X|^2 + |Y|^2) of two cannot tell a vector that turns from one
// that swings, and keeps twice the noise of the one sense of rotation.
#pragma once

#include <complex>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/dsp/rotational_filter.hpp"

namespace servosense {

enum class WaveletWindow {
  hann,
  gauss,  ///< Gabor wavelet, cut off at four standard deviations
  blackman,
  rectangular,
};

struct WaveletConfig {
  double sample_rate_hz = 8000;
  double cycles = 9.375;  ///< length of the window in periods: 500 samples at 150 Hz and 8 kHz
  WaveletWindow window = WaveletWindow::hann;
};

class WaveletTransform {
 public:
  /// An error when the record is empty or holds a number that is
  /// not finite, when the rate is not positive or `cycles` is below 1.
  [[nodiscard]] static Expected<WaveletTransform> of(std::span<const double> record,
                                                     const WaveletConfig& config);
  WaveletTransform(WaveletTransform&&) noexcept;
  WaveletTransform& operator=(WaveletTransform&&) noexcept;
  ~WaveletTransform();

  /// X(frequency, t) for each sample of the record. An error unless the frequency lies above zero
  /// and below half the sample rate, and its window is at least 4 samples long. Keeps the record's
  /// spectrum between calls: one thread at a time.
  [[nodiscard]] Expected<std::vector<std::complex<double>>> line(double frequency_hz) const;
  /// Samples in the window at that frequency.
  [[nodiscard]] std::size_t window_samples(double frequency_hz) const;
  /// Samples at either end of the record that miss a part of their window.
  [[nodiscard]] std::size_t reach(double frequency_hz) const;

 private:
  struct Content;
  explicit WaveletTransform(std::unique_ptr<Content> content);
  std::unique_ptr<Content> content_;
};

/// sqrt(|X|^2 + |Y|^2), the two-axis density of Koike 2016, ch. 6. Requires one length.
[[nodiscard]] std::vector<double> combined_density(std::span<const std::complex<double>> x,
                                                   std::span<const std::complex<double>> y);

}  // namespace servosense
