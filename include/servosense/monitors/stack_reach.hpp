// What every monitor of a stack would have found in what it has heard: how large the thing must be.
//
// Purpose: fills in MonitorAvailability::sees_from and says it in the reason. Chatter and collision
// are measured on the record (chatter_reach.hpp, collision_reach.hpp); the others follow from their
// rules, and broken teeth from the cut that was heard as well.
#pragma once

#include <memory>
#include <vector>

#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/chatter_reach.hpp"
#include "servosense/monitors/collision_reach.hpp"
#include "servosense/monitors/machine_stack.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

class StackReach {
 public:
  StackReach(const MachineFile& machine, const StackPlan& plan, double sample_period_s);
  ~StackReach();

  /// A servo sample, after the stack that prepare() has set up from the plan has heard it.
  void heard(const ServoSample<double>& sample, const HostStack& stack);
  /// The same of all drives.
  void heard(const MachineServoSample& sample, const MachineStack& stack);
  /// At the end: sees_from and reason of the monitors of the plan that ran.
  void tell(StackPlan& plan) const;

 private:
  struct Axis {
    std::size_t index;
    CollisionReach reach;
  };
  struct Spindle {
    Spindle(const MachineFile& machine, Channel channel);
    Channel channel;
    bool is_ratio = false;
    double most_torque_Nm = 0;  // that the drive can give; 0 = not known
    double rated_power_W = 0;
    double current_filter_hz = 0;         // of the drive; 0 = not known
    unsigned teeth = 0;                   // of the tool; 0 = not known
    std::unique_ptr<ChatterReach> reach;  // where the monitor runs
    bool raised = false;                  // an alarm in this record
  };
  struct Teeth {
    double usual = 0;  // of the cut with most of it...
    double lost = 0;   // ...and what a tooth has to lose of it
  };
  void hear_spindle(const RawDriveSample<double>& raw, const HostStack& stack, Spindle& spindle);
  void hear_axes_and_tool(const HostStack& stack);
  void tell_chatter(MonitorAvailability& m, const Spindle& spindle) const;
  void tell_collision(MonitorAvailability& m) const;
  void tell_teeth(MonitorAvailability& m) const;
  void tell_tool(MonitorAvailability& m, const StackPlan& plan) const;

  HostStackConfig run_;  // as it runs
  std::array<bool, kAllAxes> axis_is_ratio_{};
  Spindle spindle_, other_;  // that of the tool, and the one without
  std::vector<Axis> axes_;
  Teeth teeth_;
  double smallest_change_ = 0;  // of the specific cutting force; 0: nothing was cut
  bool tooth_raised_ = false;   // an alarm in this record
};

}  // namespace servosense
