#include "servosense/monitors/machine_stack.hpp"

namespace servosense {

MachineStack::MachineStack(const StackPlan& plan) : first_(std::make_unique<HostStack>()) {
  prepare(*first_, plan);
  changes_.reserve(2 * HostStack::kMaxChanges);  // a live run must not allocate
  if (plan.follow) follower_.emplace().configure(*plan.follow);
  if (!plan.spindle2) return;
  second_ = std::make_unique<HostStack>();
  second_->configure(plan.grouped ? in_groups(*plan.spindle2) : *plan.spindle2);
}

void MachineStack::follow() {
  const HostStack::Drive& spindle = first_->spindle();
  // In groups the last sample of one has the motion of all; the position goes on.
  const double increment = spindle.sample.position - position_;
  position_ = spindle.sample.position;
  if (!follower_->process(spindle.estimate, increment, spindle.quality)) return;
  const auto& found = follower_->state();
  first_->set_spindle_friction(found.viscous, found.coulomb);
}

std::span<const StateChange<double>> MachineStack::process(const MachineServoSample& sample) {
  const auto of_first = first_->process(sample);
  if (follower_) follow();
  if (!second_) return of_first;
  changes_.assign(of_first.begin(), of_first.end());
  ServoSample<double> second;
  second.t_ns = sample.t_ns;
  second.spindle = sample.spindle2;
  for (StateChange<double> change : second_->process(second)) {
    if (change.channel == Channel::spindle) change.channel = Channel::spindle2;
    changes_.push_back(change);
  }
  return changes_;
}

}  // namespace servosense
