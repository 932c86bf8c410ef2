// How often what a monitor hears without a cause would raise its alarm, and the threshold for a
// rate that is accepted.
//
// Purpose: an idling run lasts seconds, the accepted rate is one alarm in a hundred hours: the tail
// of what is heard has to be extended, with what that costs in certainty.
// Method: what counts is the level held for as many values in a row as an alarm takes. Its highest
// in each block of the run, longer than its memory; of these maxima the highest quarter, k of B, of
// which the next is u:
//   alarms an hour above p = blocks an hour * k/B * (1 + (p - u) / (k m))^-k,   m = mean of p_i - u
// p is the square of the value, which is exponential for Gaussian noise: an exponential tail
// (Pickands 1975, shape zero) whose scale is known from k values only, the predictive law of
// Davison (1986). Bad at: what repeats in each run and is no noise (friction at reversals): the
// margin over the highest level covers that (idle_statistics.hpp). Runs of less than kLeastBlocks
// blocks.
#pragma once

#include <cstddef>
#include <vector>

namespace servosense {

class AlarmRate {
 public:
  static constexpr std::size_t kLeastBlocks = 100, kMostBlocks = 200;
  static constexpr std::size_t kBlock = 4;  ///< of an alarm's length, at least

  /// `consecutive`: values in a row that raise an alarm, at least 1.
  explicit AlarmRate(unsigned consecutive = 1);

  /// A value as the monitor judges it (its size counts), and the time that it stands for [s]. One
  /// that is not finite is passed over.
  void add(double value, double seconds);
  /// What follows is not adjacent to what came before.
  void interrupt();

  [[nodiscard]] double hours() const { return seconds_ / 3600; }
  /// False for a run that is too short to say anything.
  [[nodiscard]] bool known() const;
  /// Level that is left at this rate [1/h]; 0 when not known, or when nothing but zeros was heard.
  [[nodiscard]] double level(double per_hour) const;
  /// Alarms an hour at `level`; not a number when not known.
  [[nodiscard]] double per_hour(double level) const;

 private:
  struct Tail {
    double u = 0, mean_excess = 0, excesses = 0, per_hour = 0;
  };
  [[nodiscard]] std::size_t blocks() const;
  [[nodiscard]] Tail tail() const;

  unsigned consecutive_;
  double seconds_ = 0;
  std::vector<double> run_;  // the last values, at most as many as an alarm takes
  std::vector<double> held_;
};

}  // namespace servosense
