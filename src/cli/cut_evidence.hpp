// The cuts of a run of `servosense monitor`, as evidence for `servosense recommend`.
//
// A cut is a stretch of revolutions whose mean torque is that of a cut (cutting_torque_Nm); air of
// eight revolutions ends it. Its speed is measured, depth and engagement are those of [cut].
//   chattered  the chatter monitor alarmed in it; with the frequency, where the advice tells it
//   stable     the monitor judged it, for so long that chatter had come up, without a warning, and
//              could have heard it by its reach
// Of any other, and of one in which the speed changes or another monitor alarms, nothing is said
// but why.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "monitor_session.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/io/watched_cut.hpp"
#include "servosense/model/milling.hpp"
#include "servosense/monitors/machine_stack.hpp"

namespace servosense::cli {

/// Depth and engagement of a cut, as a line of evidence has them; speed and outcome are the
/// caller's.
[[nodiscard]] WatchedCut watched_cut_of(const MillingCut& cut);

/// A stretch of cutting, turn by turn.
struct CutHeard {
  double from_s = 0, to_s = 0;
  std::uint64_t turns = 0, judged = 0, missed = 0;  // missed: not judged, after the first judged
  double speed_sum = 0, speed_squares = 0;          // of the turns, rad/s
  double torque_sum = 0;                            // of their means, Nm
  bool alarmed = false, warned = false, other_alarm = false;
  std::optional<std::size_t> event;  // of the chatter alarm
  unsigned air = 0;                  // turns since
};

class CutEvidence {
 public:
  /// Data error when the machine file does not say what is cut, or with how many teeth.
  static Expected<CutEvidence> create(const MachineFile& machine, const StackPlan& plan,
                                      double sample_period_s);

  /// An alarm that will be event number `event` of the run.
  void alarm(MonitorId monitor, Channel channel, std::size_t event);
  /// After the stack has heard a sample.
  void sample(double t_s, const MachineStack& stack);

  struct Told {
    std::vector<WatchedCut> cuts;
    std::vector<std::string> remarks;  ///< what was found, and why not more
  };
  /// At the end, with verdict, advice and reach of the run.
  [[nodiscard]] Told tell(const MonitorRun& run);

 private:
  using Cut = CutHeard;
  CutEvidence() = default;
  void end_turn(double t_s, const HostStack& stack);
  void end_cut();
  void begin_turn(const HostStack& stack);
  [[nodiscard]] std::string why_not(const Cut& cut, const MonitorRun& run, std::size_t i) const;

  Channel spindle_ = Channel::spindle;
  double period_s_ = 0, cutting_Nm_ = 0, slowest_rad_s_ = 0;
  unsigned teeth_ = 0;
  WatchedCut engagement_;
  std::vector<Cut> cuts_;
  std::optional<Cut> now_;
  // Of the turn so far.
  double turned_rad_ = 0, torque_sum_ = 0;
  std::uint64_t samples_ = 0, verdicts_ = 0;
};

}  // namespace servosense::cli
