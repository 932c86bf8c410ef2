// The chatter monitor of a slow record: lines of the torque, folded or not, instead of revolutions
// (identify/slow_vibration.hpp).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servosense/identify/slow_vibration.hpp"
#include "servosense/io/event.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/machine_stack.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense::cli {

/// How a spindle is heard at this rate, threshold and own lines as the machine file has them.
[[nodiscard]] SlowVibrationConfig slow_vibration_config(const MachineFile& machine, Channel spindle,
                                                        double sample_period_s);
/// Whether lines are what is listened to at this rate.
[[nodiscard]] bool is_slow(double sample_period_s);

class SlowChatterWatch {
 public:
  /// Takes over the chatter monitor of the spindles of the plan that does not run otherwise and
  /// whose threshold of a line is known. To be called before the stack is made from the plan.
  SlowChatterWatch(const MachineFile& machine, StackPlan& plan, double sample_period_s);

  [[nodiscard]] bool takes(Channel spindle) const;

  struct Change {
    StateChange<double> change;
    Event event;
  };
  /// Changes of state that a sample has brought, after the stack has heard it.
  [[nodiscard]] std::vector<Change> sample(double t_s, const MachineStack& stack);

  /// What it would have found, once the record is over.
  void tell(StackPlan& plan) const;

 private:
  struct Spindle {
    Channel channel;
    SlowVibration ear;
    std::string unit;       // of the torque
    double filter_hz = 0;   // of the drive; 0: not known
    double asked_hz = 0;    // frequency that the reach is stated for
    std::size_t since = 0;  // samples since the last verdict
    MonitorState state = MonitorState::idle;
    double needed_Nm2 = 0, heard_share = 0, largest_Nm = 0;  // sums and most of the verdicts
    std::size_t verdicts = 0;
  };
  [[nodiscard]] std::string reason(const Spindle& spindle, const SlowVibrationVerdict& v) const;

  double rate_hz_;
  std::vector<Spindle> spindles_;
};

}  // namespace servosense::cli
