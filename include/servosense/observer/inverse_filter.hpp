// Force from an accelerometer by its inverse frequency response, in blocks (overlap-save).
//
// Purpose: the force of a structure with any number of modes, from an acceleration A = G F.
// Equation: F = A conj(G) / (|G|^2 + r^2) (Tarng 1988, eq. 5-1 to 5-4; r: Wiener's share, which the
// work lacks), as a filter of N/2 + 1 taps, tapered at its ends, by the Fourier transform of N
// samples (overlap-save).
// Delay: 3 N/4 samples: N/2 of a block that has to be full, N/4 because the inverse looks ahead.
// Cost: two transforms of N samples a block of N/2. For a host: the transform is Eigen's, and its
// work comes once a block.
// Bad at: the mean, where G is 0, and all lines where |G| < r, which are lost; modes that are off;
// structures that change with position and load. Figures: docs/acceleration-force.md.
#pragma once

#include <complex>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/model/structural_mode.hpp"

namespace servosense {

/// Acceleration over force [1/kg] at the `lines` frequencies from 0 to half the rate.
[[nodiscard]] std::vector<std::complex<double>> accelerance(std::span<const StructuralMode> modes,
                                                            double sample_rate_hz,
                                                            std::size_t lines);

struct InverseFilterConfig {
  /// G at 0 to half the sample rate, N/2 + 1 lines, N a power of two from 16 to 2^20.
  std::vector<std::complex<double>> response;
  /// r, in units of G: noise of the acceleration over the force, of a line each.
  double regularisation = 0;
};

class InverseFilter {
 public:
  using Config = InverseFilterConfig;
  /// Usage error for a wrong number of lines, a regularisation that is not positive, a response
  /// that is not finite, or an inverse that remembers longer than N/4 samples: the less the
  /// regularisation and the lower what it lets through, the longer.
  static Expected<InverseFilter> make(const Config& config);
  InverseFilter(InverseFilter&&) noexcept;
  InverseFilter& operator=(InverseFilter&&) noexcept;
  ~InverseFilter();

  /// N/2: what process() takes and gives at a time.
  [[nodiscard]] std::size_t block_samples() const;
  /// Samples by which the output lies behind the input of the same place in the same block: N/4.
  /// The block itself has to be full first.
  [[nodiscard]] std::size_t delay_samples() const;
  /// Force [N] of a block of acceleration [m/s2]; both of block_samples(). What is not finite
  /// counts as zero, and is counted.
  void process(std::span<const double> acceleration, std::span<double> force);
  [[nodiscard]] std::size_t not_finite() const;
  /// Empties what the filter remembers.
  void reset();

 private:
  struct Content;
  explicit InverseFilter(std::unique_ptr<Content> content);
  std::unique_ptr<Content> content_;
};

}  // namespace servosense
