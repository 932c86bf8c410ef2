#include "servosense/monitors/machine_stack.hpp"

namespace servosense {

MachineStack::MachineStack(const StackPlan& plan)
    : first_(std::make_unique<HostStack>()), tool_spindle_(plan.tool_spindle) {
  prepare(*first_, plan);
  changes_.reserve(2 * HostStack::kMaxChanges + 1);  // a live run must not allocate
  if (plan.follow) follower_.emplace().configure(*plan.follow);
  if (plan.coefficients) {
    cut_.emplace().configure(*plan.coefficients, plan.config.tool.wear_on);
    cut_->set_program(plan.engagement_shares);
  }
  if (!plan.second) return;
  second_ = std::make_unique<HostStack>();
  second_->configure(plan.grouped ? in_groups(*plan.second) : *plan.second);
}

void MachineStack::follow() {
  const HostStack::Drive& spindle = first_->spindle();
  if (!follower_->process(spindle.estimate, first_->spindle_increment(), spindle.quality)) return;
  const auto& found = follower_->state();
  first_->set_spindle_friction(found.viscous, found.coulomb);
}

void MachineStack::add(std::span<const StateChange<double>> changes, Channel spindle) {
  for (StateChange<double> change : changes) {
    if (change.channel == Channel::spindle) change.channel = spindle;
    changes_.push_back(change);
  }
}

std::span<const StateChange<double>> MachineStack::process(const MachineServoSample& sample) {
  const auto of_first = first_->process(sample.of_spindle(tool_spindle_));
  if (follower_) follow();
  if (tool_spindle_ == Channel::spindle && !second_ && !cut_) return of_first;
  changes_.clear();
  add(of_first, tool_spindle_);
  if (StateChange<double> change; cut_ && cut_->process(*first_, change))
    changes_.push_back(change);
  if (!second_) return changes_;
  const Channel other = other_spindle(tool_spindle_);
  ServoSample<double> second;
  second.t_ns = sample.t_ns;
  second.spindle = sample.drive(other);
  add(second_->process(second), other);
  return changes_;
}

}  // namespace servosense
