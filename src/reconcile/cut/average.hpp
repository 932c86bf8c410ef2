// Forces averaged over revolutions: what turns with the tool stays, noise and what is fixed in time
// go.
#pragma once

#include <Eigen/Dense>
#include <cstddef>
#include <utility>
#include <vector>

#include "reconcile/cut/bins.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/reconcile/cutting.hpp"

namespace servosense::reconcile {

/// Stretches at one feed and one speed.
struct CutLevel {
  double feed_per_tooth_m = 0;
  double speed_rad_s = 0;
  double samples_per_turn = 0;
  BinnedAngles angles;  ///< of the samples fitted
};

/// Whole revolutions in a row. Vectors: x of all bins, then y.
struct CutBlock {
  std::size_t level = 0;
  bool held_out = false;
  double time_s = 0;  ///< of its middle
  Eigen::VectorXd mean, count;
};

/// One revolution of a block.
struct CutTurn {
  std::size_t first = 0, last = 0;  ///< samples
  std::size_t block = 0;
  bool begins = false;  ///< the first after an entry, or at another feed
};

struct CutAverage {
  std::vector<CutLevel> levels;
  std::vector<CutBlock> blocks;
  std::vector<CutTurn> turns;
  std::size_t bins = 0;
  double noise_N = 0;   ///< of a sample, from one revolution to the next
  double effort_N = 0;  ///< rms of the averaged forces
  double held_from_s = 0, held_to_s = 0;
  std::vector<std::size_t> block_of;  ///< of each sample; kNone: not in steady cutting
  std::vector<std::size_t> level_of;  ///< alike, where a revolution still rings, too
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  /// Of an angle of the spindle.
  [[nodiscard]] Eigen::Index bin_of(double angle_rad) const;
  /// Means of one level over the blocks fitted, or over those held out, and how many samples are in
  /// each; where there are none the mean is 0.
  [[nodiscard]] std::pair<Eigen::VectorXd, Eigen::VectorXd> mean_of(std::size_t level,
                                                                    bool held_out) const;
};

/// Data error when there is too little steady cutting.
Expected<CutAverage> average(const CuttingData& data, const Options& options);

/// Forces that a model predicts: `sample_*` at every sample, `bins` at the bins of every level.
struct CutPrediction {
  Column x_N, y_N;
  std::vector<Eigen::VectorXd> bins;
};

/// Averages again what the prediction leaves, so that samples which fall elsewhere within their bin
/// do not count as noise, without the revolutions that still ring by it.
void average_again(CutAverage& average, const CuttingData& data, const CutPrediction& prediction,
                   const Criteria& criteria);

}  // namespace servosense::reconcile
