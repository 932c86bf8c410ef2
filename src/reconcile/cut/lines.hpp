// Lines fixed in time: pump, fan, foundation. The average over revolutions does not see them; they
// only make it noisier.
#pragma once

#include <cstddef>
#include <vector>

#include "servosense/reconcile/criteria.hpp"
#include "servosense/reconcile/problem.hpp"

namespace servosense::reconcile {

/// x(t) = cosine cos(2 pi f t) + sine sin(2 pi f t), t that of the trace; y likewise.
struct TimeLockedLine {
  double frequency_hz = 0;
  double cosine_N[2] = {0, 0};
  double sine_N[2] = {0, 0};
  double error_N = 0;  ///< standard error of each of the four
  double frequency_error_hz = 0;
  double held_mean_square_N2 = 0;  ///< by which it shrinks the samples kept for the proof
  [[nodiscard]] double amplitude_N(std::size_t axis) const;
  /// Mean over both forces.
  [[nodiscard]] double mean_square_N2() const;
  void subtract_from(const Column& time_s, Column& x_N, Column& y_N) const;
};

/// What is left of both forces at each sample, without what turns with the tool: its mean over
/// angles so coarse that every revolution meets all of them, and over finer ones.
struct LineSearch {
  const Column &time_s, &feed_m;
  Column x_N, y_N;
  Column finer_x_N, finer_y_N;
  std::vector<bool> fitted, held_out;  ///< samples that count; the others are not looked at
  double turn_hz = 0;                  ///< what falls on a multiple of it turns with the tool
  double most_hz = 0;                  ///< beyond it the means do not follow
  double least_N = 0;                  ///< a line of less rms is not worth it
};

/// The strongest first. Frequency, amplitude and phase are those of the fitted samples; a line
/// counts when it keeps all three on to the end of the record, which it must for the most part
/// remove there, and does not go with the feed.
[[nodiscard]] std::vector<TimeLockedLine> find_lines(LineSearch search,
                                                     const Criteria& criteria = kCriteria);

/// Rms of what neither turns with the tool nor is noise, of one force over the samples fitted: less
/// the finer means and the level on which the lines of the spectrum stand.
[[nodiscard]] double unsteady_N(const LineSearch& search);

}  // namespace servosense::reconcile
