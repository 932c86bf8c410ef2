// Thresholds of the reconcile workflow, each with its reason.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>

namespace servosense::reconcile {

struct Options {
  /// Less gain than this share of the noise floor is not worth a term in the model.
  double least_gain_in_floors = 0.6;
  /// Less gain than this share of the effort's rms is below what friction laws agree among
  /// themselves, however quiet the sensors are.
  double least_gain_in_effort = 0.0025;
  /// The same for a bristle, which lives where friction laws differ: just after reversals.
  double least_gain_of_bristle_in_floors = 1.2;
  double least_gain_of_bristle_in_effort = 0.005;
  /// And for a spring that friction winds up.
  double least_gain_of_winding_in_effort = 0.005;
  /// Least gain of a further effect, in gains of the largest found: no law is exact to more than
  /// some per cent, and what it leaves must not be named. Effects with memory imitate the most.
  double least_gain_beside = 0.03;
  double least_gain_beside_memory = 0.15;
  /// Least confidence of an effect with memory beside another effect.
  double least_confidence_beside = 0.9;
  /// A term that explains less of what is beyond the noise is a proxy, not the cause.
  double least_explained = 0.3;
  /// Where that is not reached, and what is left is no function of any coordinate: share of what
  /// the effect and the best free function explain together (1: never)...
  double least_explained_of_seen = 1;
  /// ...and of what is beyond the noise.
  double least_explained_beside_unseen = 0.1;
  /// Two candidates whose losses differ by fewer standard errors than this are one class.
  double class_standard_errors = 2;
  /// Columns that agree beyond this, known terms removed, are one class.
  double class_correlation = 0.98;
  /// Share of resampled data sets that must pick the same name (or class).
  double least_pick_frequency = 0.6;
  /// Norm left of a candidate's column after removing what the known terms can imitate.
  double least_testable = 0.03;
  /// Largest relative change of a coefficient between halves of the range.
  double largest_inconstancy = 0.5;
  /// Share of what is left that a free function may explain where a name claims to have done so.
  double largest_proxy = 0.25;
  /// Share of its relative gain on fitted rows that an effect must reach on held-out ones.
  double least_held_out_share = 0.3;
  /// Share of the variance beyond the noise that makes a line in time worth reporting.
  double least_line_share = 0.1;
  /// A gap below this many noise floors is at the floor: friction laws differ by as much.
  double floor_tolerance = 1.5;
  /// At most this many effects: more is a sign that the model is of another machine.
  unsigned most_effects = 5;
  /// Last part of the trace, kept for the proof.
  double held_out_share = 1.0 / 3;
  unsigned blocks = 24;      ///< of which losses are left out, resampled and compared
  unsigned resamples = 100;  ///< bootstrap data sets
  /// Records made of the refitted model and its noise, sent through the search: what they show is
  /// chance. Few, so the tail is extrapolated.
  unsigned null_records = 12;
  /// Probability that any of the catalogue goes beyond it by chance.
  double null_probability = 0.01;
  /// A parameter has changed when it moved by this many standard errors of the difference...
  double changed_standard_errors = 4;
  /// ...and by this share of what it was: friction differs by as much between a cold and a warm
  /// day.
  double least_change = 0.08;
  std::uint64_t seed = 1;
  unsigned threads = 0;  ///< 0: one a core
  /// Told how far the work is: what is being done, and how much of it. Comes from any thread.
  std::function<void(const char* what, std::size_t done, std::size_t of)> progress;
  /// Presliding distance and timing were found without the effects: what takes the gap beside a
  /// large one down to the noise may be the presliding distance itself.
  bool before_recalibration = false;

  /// Least gain of an effect beside a noise floor, in a record with this rms of the effort.
  [[nodiscard]] double least_gain(double floor, double effort_rms, bool bristle = false) const {
    return bristle ? std::max(least_gain_of_bristle_in_floors * floor,
                              least_gain_of_bristle_in_effort * effort_rms)
                   : std::max(least_gain_in_floors * floor, least_gain_in_effort * effort_rms);
  }
};

}  // namespace servosense::reconcile
