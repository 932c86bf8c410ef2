// What cuts that chattered, or did not, say of tool and structure (Bayes).
//
// Likelihood of a label: with mu the largest multiplier of the cut by semi-discretisation,
//   P(chatter) = e + (1 - 2 e) / (1 + exp(-ln|mu| / g)),
// e the probability of a wrong label, g a soft margin: what grows so slowly is not seen. The
// frequency of chatter is normal about that of the multiplier, or, with a small probability,
// anything.
// Sampler: the cuts come one after the other, each tempered so far that the effective number of
// samples stays above half of all; then the samples are drawn anew and moved by Metropolis steps of
// their own covariance (sequential Monte Carlo: Del Moral, Doucet and Jasra 2006). Where too few
// samples move, the sampler says so.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/uncertain_cut.hpp"
#include "servosense/io/watched_cut.hpp"

namespace servosense {

struct WatchedCutsConfig {
  double wrong_label = 0.02;  ///< e (chosen: one note in fifty is wrong), 0..0.5
  /// g (chosen: a vibration that grows less in a tooth period is not seen in some hundred teeth),
  /// above 0.
  double soft_margin = 0.01;
  double frequency_error = 0.01;      ///< of chatter_hz, of it (chosen: it moves as chatter grows)
  double frequency_error_hz = 3;      ///< and at least (chosen: what a third of a second resolves)
  double wrong_frequency = 0.1;       ///< probability that it is another line (chosen)
  double highest_frequency_hz = 8e3;  ///< which then lies anywhere below
  Eigen::Index samples = 400;
  int moves = 3;  ///< Metropolis steps of each sample after it was drawn anew
  std::uint64_t seed = 1;
  unsigned threads = 0;
  std::function<void(double)> progress;  ///< share done
};

struct CutsLearned {
  CutBelief belief;
  /// Least effective number of samples before they were drawn anew, as a share.
  double least_effective_share = 1;
  /// Share of the samples that moved when they were last drawn anew; 1 when they never were.
  double moved_share = 1;
  /// Probability of chatter of each cut in the end.
  std::vector<double> chatter_probability;
};

/// Errors: a cut whose engagement is refused, as by SemiDiscretization::create; samples so bad that
/// fewer than a tenth of them moved (the cuts contradict each other or the file).
Expected<CutsLearned> learn_from_cuts(const UncertainCut& cut, std::span<const WatchedCut> cuts,
                                      const WatchedCutsConfig& config = {});

}  // namespace servosense
