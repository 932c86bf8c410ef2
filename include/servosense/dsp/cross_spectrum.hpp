// Auto and cross spectra of two signals of one record, averaged over segments (offline).
//
// Welch (1967): segments of N samples, Hann window, half overlap, as dsp/power_spectrum.hpp; Pxy is
// the mean of conj(X) Y (Bendat and Piersol 2010, sec. 9.2). Sums over runs of neighbouring
// segments are kept beside the whole, for who draws them anew.
#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

namespace servosense {

/// Sums over segments, lines 0 .. N / 2; divided by the segments they are means.
struct CrossSums {
  std::size_t segments = 0;
  std::vector<double> input, output;        ///< |X|^2, |Y|^2
  std::vector<std::complex<double>> cross;  ///< conj(X) Y

  CrossSums& operator+=(const CrossSums& other);
  /// Adds a segment by its first `input.size()` lines, of which there have to be so many.
  void add(std::span<const std::complex<double>> x, std::span<const std::complex<double>> y);

  /// Of line `m`: Pxy / Pxx, which noise on the output does not bend; 0 without input.
  [[nodiscard]] std::complex<double> h1(std::size_t m) const;
  /// Pyy / conj(Pxy), which noise on the input does not bend; 0 where they have nothing in common.
  [[nodiscard]] std::complex<double> h2(std::size_t m) const;
  /// Geometric mean of the two: total least squares for noise that is as large a share of either
  /// signal (Rocklin, Crowley and Vold 1985).
  [[nodiscard]] std::complex<double> hv(std::size_t m) const;
  /// |Pxy|^2 / (Pxx Pyy), 0..1, of one segment always 1; 0 without input or output.
  [[nodiscard]] double coherence(std::size_t m) const;
};

struct CrossSpectrum {
  CrossSums whole;
  std::vector<CrossSums> parts;  ///< of neighbouring segments; together they are the whole
  /// By how much the variance of `cross`, given the input, exceeds that of as many independent
  /// segments, a factor a line: half overlapping segments share a sixth of their noise, which
  /// counts by how alike the input was in them.
  std::vector<double> overlap;
  /// What white noise of unit variance puts into |X|^2 of a segment.
  double noise_gain = 0;
};

/// `segment` a power of two of at least 16. The output is read `delay` samples later than the
/// input, so that a lag is not lost in the segment. Samples that are left over are not used;
/// without a whole segment the sums are empty. At most `most_parts` parts.
[[nodiscard]] CrossSpectrum cross_spectrum(std::span<const double> input,
                                           std::span<const double> output, std::size_t segment,
                                           std::ptrdiff_t delay = 0, std::size_t most_parts = 64);

}  // namespace servosense
