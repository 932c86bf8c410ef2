// How often what a monitor hears without a cause would raise its alarm, and the threshold for a
// rate that is accepted.
//
// Purpose: an idling run lasts seconds, the accepted rate is one alarm in a hundred hours: the tail
// of what is heard has to be extended, with what that costs in certainty.
// Method: what counts is the level held for as many values in a row as an alarm takes. Of the
// highest of each of B chances, the highest k, of which the next is u:
//   alarms an hour above p = chances an hour * k/B * (1 + (p - u) / (k m))^-k,   m = mean of p_i -
//   u
// p is the square of the value, which is exponential for Gaussian noise: an exponential tail
// (Pickands 1975, shape zero) whose scale is known from k values only, the predictive law of
// Davison (1986). The fewer values, the heavier it is.
// Chances: of noise, blocks of the run longer than its memory, and their highest quarter
// (AlarmRate); of what comes with a motion, the times that it came, and their highest half, since
// they are few (PeakTail).
// Bad at: motions that the run does not hold; runs of less than kLeastBlocks blocks.
#pragma once

#include <cstddef>
#include <vector>

namespace servosense {

/// The predictive law above.
class PeakTail {
 public:
  static constexpr std::size_t kLeast = 4;  ///< chances; fewer say nothing

  PeakTail() = default;
  /// `highest`: of each chance, in any order. `parts`: one in so many makes the tail. `hours` of
  /// the run.
  PeakTail(std::vector<double> highest, unsigned parts, double hours);

  [[nodiscard]] bool known() const { return excesses_ > 0; }
  /// Level that is left at this rate [1/h]; 0 when not known, or when nothing but zeros was heard.
  [[nodiscard]] double level(double per_hour) const;
  /// Alarms an hour at `level`; not a number when not known. `times`: as a run would say that is so
  /// many times as long.
  [[nodiscard]] double per_hour(double level, double times = 1) const;

 private:
  double u_ = 0, mean_excess_ = 0, excesses_ = 0, per_hour_ = 0;
};

/// Of noise.
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
  [[nodiscard]] double level(double per_hour) const { return tail().level(per_hour); }
  /// Alarms an hour at `level`; not a number when not known.
  [[nodiscard]] double per_hour(double level) const { return tail().per_hour(level); }

 private:
  [[nodiscard]] std::size_t blocks() const;
  [[nodiscard]] PeakTail tail() const;

  unsigned consecutive_;
  double seconds_ = 0;
  std::vector<double> run_;  // the last values, at most as many as an alarm takes
  std::vector<double> held_;
};

}  // namespace servosense
