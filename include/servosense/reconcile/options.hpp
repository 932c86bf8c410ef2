// What whoever asks may choose: how a record is divided, how much is computed. The limits by which
// something is decided are criteria.hpp.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>

#include "servosense/reconcile/criteria.hpp"

namespace servosense::reconcile {

struct Options {
  Criteria criteria;
  /// At most this many effects: more is a sign that the model is of another machine.
  unsigned most_effects = 5;
  /// Last part of the trace, kept for the proof.
  double held_out_share = 1.0 / 3;
  unsigned blocks = 24;      ///< of which losses are left out, resampled and compared
  unsigned resamples = 100;  ///< bootstrap data sets
  /// Records made of the refitted model and its noise, sent through the search: what they show is
  /// chance. Few, so the tail is extrapolated.
  unsigned null_records = 12;
  std::uint64_t seed = 1;
  unsigned threads = 0;  ///< 0: one a core
  /// Told how far the work is: what is being done, and how much of it. Comes from any thread.
  std::function<void(const char* what, std::size_t done, std::size_t of)> progress;
  /// The presliding distance and timing were found without the effects: what takes the gap beside a
  /// large one down to the noise may be the presliding distance itself.
  bool before_recalibration = false;

  /// Least gain of an effect beside a noise floor, in a record with this rms of the effort.
  [[nodiscard]] double least_gain(double floor, double effort_rms, bool bristle = false) const {
    const Criteria& c = criteria;
    return bristle ? std::max(c.least_gain_of_bristle_in_floors * floor,
                              c.least_gain_of_bristle_in_effort * effort_rms)
                   : std::max(c.least_gain_in_floors * floor, c.least_gain_in_effort * effort_rms);
  }
};

}  // namespace servosense::reconcile
