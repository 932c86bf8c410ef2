// What an idling run says of signals that come in pairs (monitors/paired_signals.hpp).
//
// Purpose: terms and band of each pair for the watch, and what the difference tells of the machine.
// Method: least squares, errors as for the idling run itself (idle_regression.hpp).
//   load       scale - motor = zero + b x - lag v - w/2 S - u / k + sum A_n sin(n theta + p_n)
//     over the rows in which the load lies on its flank for sure: far enough behind a reversal, and
//     not braked harder than half its friction would. w is backlash. u / k: windup by the motor's
//     effort u; with the motor held the load swings at sqrt(k / J). What friction at the load winds
//     up is in w if it is more than its part of u, or less: 2 C / k is added to the error of w.
//   following  command - actual = zero + v / Kv + ...: 1 / Kv of a loop without feed forward
//   command    effort - command = zero - tau w': mean delay of the current loop
// Bands: 1.5 times the largest of the run, what noise leaves at the accepted rate (alarm_rate.hpp),
// and a floor that is a convention (kOfEffort, kOfFollowing, kExpansion).
// Bad at: a lag of scale against motor that changes; friction at the load alone.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/monitors/paired_signals.hpp"

namespace servosense {

/// The settled samples of an idling run, some 250 a second.
struct PairRecord {
  PairedColumns columns;
  double unit_per_count = 0;
  double unit_per_turn = 0;  ///< travel of a turn of the motor; 0: not known
  double raw_period_s = 0;   ///< of the rows
  std::vector<PairSample> samples;
};

struct LearnedPair {
  PairKind kind = PairKind::load;
  PairTerms terms;
  double largest = 0;  ///< that the run has [m, rad, N or Nm]
  double band = 0;
};

/// Between motor and load.
struct LoadPath {
  Estimate backlash;               ///< m or rad; a value within three errors of zero is none
  Estimate effort_per_difference;  ///< k [N/m or Nm/rad]; 0 +- 0: the effort has no sign
  Estimate held_resonance_hz;      ///< of the load with the motor held; 0 +- 0: not shown
  Estimate slope;                  ///< of the lead error
  std::array<Estimate, 2> cyclic;  ///< amplitude once and twice a turn of the motor [m or rad]
  [[nodiscard]] bool has_backlash() const { return backlash.value > 3 * backlash.standard_error; }
  [[nodiscard]] bool has_compliance() const {
    return effort_per_difference.value > 3 * effort_per_difference.standard_error &&
           held_resonance_hz.value > 0;
  }
};

struct LearnedPairs {
  PairTerms idle_effort;
  std::vector<LearnedPair> pairs;
  std::optional<LoadPath> load;
  std::optional<Estimate> following_time_s;  ///< following error over velocity
  std::optional<Estimate> command_delay_s;
  std::vector<std::string> remarks;
};

/// Data error where motor and scale, or the motors of a gantry, do not count the same motion: which
/// keys of the machine file to look at. A pair that the record does not show is left out with a
/// remark. `effort_has_sign`: else nothing is said of compliance and of efforts.
Expected<LearnedPairs> learn_pairs(const PairRecord& record, bool effort_has_sign,
                                   double false_alarm_rate_per_hour);

}  // namespace servosense
