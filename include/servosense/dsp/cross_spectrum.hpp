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
