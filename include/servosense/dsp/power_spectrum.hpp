// Averaged power spectrum of a long record, in constant memory (offline).
//
// Welch (1967): segments of N samples, Hann window, half overlap, mean of |FFT|^2. Scaled so that
// the lines of a sinusoid of amplitude A sum to A^2/2, and the lines of noise to its variance.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

namespace servosense {

class PowerSpectrum {
 public:
  /// `segment` a power of two of at least 16; `sample_rate_hz` positive.
  PowerSpectrum(std::size_t segment, double sample_rate_hz);
  PowerSpectrum(PowerSpectrum&&) noexcept;
  PowerSpectrum& operator=(PowerSpectrum&&) noexcept;
  ~PowerSpectrum();

  /// Adds a sample; one that is not finite begins a new segment.
  void add(double sample);
  [[nodiscard]] std::size_t segments() const;
  /// 0 .. half the sample rate, segment / 2 + 1 lines [Hz].
  [[nodiscard]] std::vector<double> frequency_hz() const;
  /// Mean square per line, in the square of the sample's unit; zeros before the first segment.
  [[nodiscard]] std::vector<double> power() const;

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

}  // namespace servosense
