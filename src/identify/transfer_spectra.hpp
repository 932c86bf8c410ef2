// Records' cross spectra, and the transfer function that they have in common.
#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "servosense/dsp/cross_spectrum.hpp"
#include "servosense/identify/transfer.hpp"

namespace servosense::transfer {

/// Estimate of one line.
struct Line {
  std::complex<double> h;
  double coherence = 0;
  double variance = 0;  ///< of either component, over |h|^2
  double freedom = 0;   ///< degrees of it (Satterthwaite 1946)
  double disagree = 0;  ///< squares of the records' deviations over their variances
  [[nodiscard]] bool known() const { return std::abs(h) > 0; }
};

/// All records at one length of segment, the output shifted by one delay.
class Spectra {
 public:
  Spectra(std::span<const TransferRecord> records, std::size_t segment, std::ptrdiff_t delay,
          double input_noise2);

  [[nodiscard]] std::size_t segment() const { return segment_; }
  [[nodiscard]] std::ptrdiff_t delay() const { return delay_; }
  [[nodiscard]] std::size_t segments() const;
  /// Of the record that has most.
  [[nodiscard]] std::size_t most_segments() const;
  /// Lines 0 .. segment / 2; the first and the last stay empty.
  [[nodiscard]] const std::vector<Line>& lines() const { return lines_; }
  [[nodiscard]] bool excited(std::size_t m) const;
  /// |X|^2 of all records together.
  [[nodiscard]] std::vector<double> input() const;
  /// Samples by which the output still comes late: the highest point of the cross correlation, each
  /// line weighted by what is known of its phase (Hannan and Thomson 1973).
  [[nodiscard]] std::ptrdiff_t late() const;
  /// Of the gain, percentiles over segments drawn anew (Efron 1979).
  [[nodiscard]] std::vector<std::pair<double, double>> drawn(double outside) const;

 private:
  struct OfRecord {
    CrossSpectrum s;
    std::vector<bool> excited;
  };
  [[nodiscard]] Line merged(const std::vector<CrossSums>& sums, std::size_t m) const;

  std::size_t segment_;
  std::ptrdiff_t delay_;
  double input_noise2_;
  std::vector<OfRecord> records_;
  std::vector<Line> lines_;
};

/// Half overlapping segments that all records hold.
[[nodiscard]] std::size_t segments_in(std::span<const TransferRecord> records, std::size_t segment);

}  // namespace servosense::transfer
