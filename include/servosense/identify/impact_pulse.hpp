// The force of a hammer: where its pulse lies, and the window that keeps the pulse alone.
//
// Cosine taper (Dunwoody 2010, eq. 4.17): 1 from 1.5 shoulders before the peak to 1.5 behind it,
// down to 0 within one shoulder more on either side. A shoulder is the time from the peak to where
// the force has fallen to a tenth of it.
//
// Of white noise on the force the window leaves sqrt(sum w^2 / N) (eq. 4.16): 6 % with a pulse of
// 0.4 ms in a record of 0.2 s.
#pragma once

#include <cstddef>
#include <span>

namespace servosense {

struct ForcePulse {
  std::size_t peak = 0;  ///< sample of it
  double peak_N = 0;     ///< with its sign
  /// Samples from the peak back and on to the first at or below a tenth of it; 0: the record ends
  /// before.
  std::size_t before = 0, after = 0;
};

/// The pulse whose highest sample is `peak`; `force_N` without offset.
[[nodiscard]] ForcePulse pulse_about(std::span<const double> force_N, std::size_t peak);

/// Samples are those of the record in which the pulse lies.
class ForceWindow {
 public:
  /// A missing shoulder is taken to be as long as the other one.
  explicit ForceWindow(const ForcePulse& pulse);
  [[nodiscard]] double operator()(std::ptrdiff_t sample) const;
  /// First sample and the one behind the last that count; they may lie outside of the record.
  [[nodiscard]] std::ptrdiff_t begin() const;
  [[nodiscard]] std::ptrdiff_t end() const;
  /// Sum of squares of the window.
  [[nodiscard]] double power() const;

 private:
  double peak_, before_, after_;
};

}  // namespace servosense
