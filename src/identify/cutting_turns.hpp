// Means of signals over whole turns of the spindle.
#pragma once

#include <cstddef>
#include <vector>

#include "servosense/identify/cutting.hpp"

namespace servosense::cutting_turns {

/// Whole turns in a row, as many as last kLeast_s; begin and end are instants in samples.
struct Turns {
  double from = 0, to = 0;
  double speed_rad_s = 0;
};
constexpr double kLeast_s = 0.01;     // shorter, a turn is joined with the next
constexpr double kSlowest_rad_s = 5;  // 50 rpm: slower, the spindle stands
constexpr std::size_t kLeastSamples = 4;

/// All whole turns of a record, in order; a gap where the spindle stands.
[[nodiscard]] std::vector<Turns> turns_of(const CuttingRecord& record);

/// Running integral of a signal, for means between two instants in samples.
class Means {
 public:
  explicit Means(const std::vector<double>& values);
  /// NaN where a value between is.
  [[nodiscard]] double operator()(double from, double to) const;

 private:
  [[nodiscard]] double at(double instant) const;
  std::vector<double> sum_;           // of the values before each sample
  std::vector<std::size_t> invalid_;  // values before each sample that are none
};

/// Mean of a signal over [first, last) of the turns, with its standard error: batches of turns that
/// are longer than the sensor's memory, neighbours correlated, and what a quantum hides.
[[nodiscard]] CutMean mean_over(const CuttingSignal& signal, const Means& means,
                                const std::vector<Turns>& turns, std::size_t first,
                                std::size_t last, double sample_period_s);

}  // namespace servosense::cutting_turns
