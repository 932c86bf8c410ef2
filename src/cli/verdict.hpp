// The verdict of a run: what watched and for how long, what did not and why.
//
// A monitor that is planned may still have watched nothing: the spindle stood, the signal was
// faulty, the window never filled. So the time that each one was armed is counted from its changes
// of state, and held against the time in which it was due:
//   collision              the whole record, from the first value on that is not zero
//   chatter                while the spindle turns
//   a monitor of the tool  while it is not idle: it idles where there is no cut of its kind
// One that could not have seen anything in these cuts (SeesFrom::blind) has not watched, however
// long it was armed.
// The verdict is then, in this order:
//   alarm            one was raised
//   not-watched      no monitor of the cut was ever armed
//   warning          one was raised, about the cut or about a signal
//   partly-watched   a drive of the machine file or of the source was not watched, a monitor that
//   is
//                    asked for could not run, or one that ran was armed for less than half of its
//                    time or faulty for more than a tenth of it
//   clear            else
// Asked for are chatter and collision on every drive that there is, and a monitor of the tool that
// has a section in the machine file; none that the machine file switches off.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/machine_stack.hpp"

namespace servosense::cli {

/// Of one planned monitor, in the order of StackPlan::monitors.
struct Watched {
  bool wanted = false;               ///< asked for
  double armed_s = 0;                ///< armed, in warning or in alarm, its signals sound
  double faulty_s = 0;               ///< its signals could not be trusted
  double due_s = 0;                  ///< time in which it should have been armed
  std::uint64_t faulty_samples = 0;  ///< of a signal: every one
  std::string why;                   ///< why it did not watch, or not enough; empty when it did
};

/// Follows the monitors through a run.
class WatchTally {
 public:
  /// Adds a monitor that does not run to the plan for every drive of the source that the plan does
  /// not speak of.
  WatchTally(const MachineFile& machine, const std::vector<Signal>& signals, StackPlan& plan);
  void change(const StateChange<double>& change, double t_s);
  void sample(double t_s, const MachineStack& stack);
  /// At the end of the record.
  [[nodiscard]] std::vector<Watched> finish(const StackPlan& plan, const MachineStack& stack,
                                            double sample_period_s);

 private:
  struct Timeline {
    MonitorId monitor = MonitorId::signal;
    Channel channel = Channel::machine;
    MonitorState state = MonitorState::idle;
    bool sound = true;  // of a signal: its drive's monitors may believe it
    double since_s = 0;
    double armed_s = 0, idle_s = 0, faulty_s = 0;
    bool wanted = false;
  };
  /// Of a monitor that learns its tool: how much of it was heard; empty where it is taught, or has
  /// heard nothing.
  [[nodiscard]] static std::string taught_so_far(MonitorId monitor, const StackPlan& plan,
                                                 const MachineStack& stack);
  /// A tool has no signals of its own: its monitors hear its spindle at least, and so do sensors.
  [[nodiscard]] Channel heard_on(Channel channel) const;
  [[nodiscard]] const Timeline* signal_of(Channel channel) const;
  void advance(Timeline& line, double t_s) const;

  Channel tool_spindle_;
  std::vector<Timeline> lines_;
  double from_s_ = 0, to_s_ = 0;
  bool started_ = false;
  double stretch_from_s_ = 0;
  // The way that a spindle goes in a stretch of time.
  struct Turning {
    Channel channel;
    double slowest_chatter_rad_s = 0;  // that is listened to
    double stretch_from_rad = 0;
    double turning_s = 0, fastest_rad_s = 0;
  };
  std::vector<Turning> spindles_;
  [[nodiscard]] Turning turning_of(Channel channel) const;
};

/// Spelled as in --json.
enum class VerdictWord { not_watched, partly_watched, clear, warning, alarm };
[[nodiscard]] const char* name_of(VerdictWord word) noexcept;

struct Verdict {
  VerdictWord word = VerdictWord::not_watched;
  std::string sentence;                 ///< what watched, what did not and why, the alarms
  std::size_t watched = 0, wanted = 0;  ///< monitors of the cut
};
[[nodiscard]] Verdict verdict_of(const StackPlan& plan, const std::vector<Watched>& watched,
                                 std::uint64_t alarms, std::uint64_t warnings, double duration_s);

}  // namespace servosense::cli
