// Every drive of a machine as a host watches it: the monitor stack of the spindle that has the
// tool, and a second one for the other spindle, which has no axes and no tool.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "servosense/monitors/cut_beside_stack.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

class MachineStack {
 public:
  /// prepare()d from the plan, whose references must outlive the use of this.
  explicit MachineStack(const StackPlan& plan);

  /// One servo period. Returns the monitors whose state changed; valid until the next call.
  std::span<const StateChange<double>> process(const MachineServoSample& sample);

  /// Where the machine file has the friction of the spindle followed; else nullptr.
  [[nodiscard]] const FrictionFollower<double>* follower() const {
    return follower_ ? &*follower_ : nullptr;
  }
  /// Where the plan has it; else nullptr.
  [[nodiscard]] const CuttingCoefficients<double>* coefficients() const {
    return cut_ ? &cut_->coefficients() : nullptr;
  }
  [[nodiscard]] const HostStack& first() const { return *first_; }
  /// The stack that hears a drive.
  [[nodiscard]] const HostStack& stack_of(Channel drive) const {
    return second_ && drive == other_spindle(tool_spindle_) ? *second_ : *first_;
  }
  [[nodiscard]] const HostStack::Drive& drive(Channel drive) const {
    return is_spindle(drive) ? stack_of(drive).spindle() : first_->axis(axis_index(drive));
  }
  [[nodiscard]] const SignalHealthMonitor<double>& health(Channel drive) const {
    return is_spindle(drive) ? stack_of(drive).spindle_health()
                             : first_->axis_health(axis_index(drive));
  }

 private:
  void follow();
  void add(std::span<const StateChange<double>> changes, Channel spindle);

  std::unique_ptr<HostStack> first_, second_;
  std::optional<CutBesideStack<double>> cut_;
  std::optional<FrictionFollower<double>> follower_;  // of the spindle
  Channel tool_spindle_;
  std::vector<StateChange<double>> changes_;
};

}  // namespace servosense
