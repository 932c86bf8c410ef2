// Columns smoothed, differentiated, read between their samples.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "servosense/reconcile/problem.hpp"

namespace servosense::reconcile {

/// How far a sample reaches through it, in periods of the corner.
inline constexpr double kFilterReach = 0.5;

/// A Gaussian hole in a spectrum.
struct Notch {
  double frequency_hz = 0;  ///< of its bottom; 0: none
  double width_hz = 0;      ///< standard deviation
};

/// A Gaussian low-pass, with a notch where one is asked for, and its derivatives. Zero phase, short
/// memory, no ringing; sums and differences of it are exact on constants, ramps and parabolas.
class Smoother {
 public:
  /// `corner_hz`: half power. `period_s`: of the samples.
  Smoother(double corner_hz, double period_s, Notch notch = {});
  [[nodiscard]] std::size_t reach() const { return reach_; }
  /// Derivative of `order` 0, 1 or 2 at every `stride`-th sample; ends are held.
  [[nodiscard]] Column apply(const Column& samples, int order, std::size_t stride) const;

 private:
  void cut_out(Notch notch, double period_s);

  std::size_t reach_;
  std::vector<double> kernel_[3];
};

/// One less the other, of equal length.
Column difference(Column a, const Column& b);
/// Adds a multiple of a column of the same length.
void add_to(Column& to, double factor, const Column& column);

/// A place between two samples, for any column of their times.
struct Place {
  std::size_t below, above;
  double at;  ///< samples
  [[nodiscard]] double of(const Column& samples) const {
    return samples[below] + (at - static_cast<double>(below)) * (samples[above] - samples[below]);
  }
};

/// Straight line between samples; ends are held.
inline double between_samples(const Column& samples, double index) {
  const std::size_t last = samples.size() - 1;
  const double at = std::clamp(index, 0.0, static_cast<double>(last));
  const auto below = static_cast<std::size_t>(at);
  return Place{below, std::min(below + 1, last), at}.of(samples);
}

}  // namespace servosense::reconcile
