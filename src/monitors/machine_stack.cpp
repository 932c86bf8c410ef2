#include "servosense/monitors/machine_stack.hpp"

namespace servosense {

MachineStack::MachineStack(const StackPlan& plan)
    : first_(std::make_unique<HostStack>()), tool_spindle_(plan.tool_spindle) {
  prepare(*first_, plan);
  changes_.reserve(2 * HostStack::kMaxChanges + 1);  // a live run must not allocate
  if (plan.follow) follower_.emplace().configure(*plan.follow);
  if (plan.coefficients) coefficients_.emplace().monitor.configure(*plan.coefficients);
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

void MachineStack::hear_cut() {
  CutBesideStack& c = *coefficients_;
  const HostStack::Drive& spindle = first_->spindle();
  // In groups the last sample of one has the motion of all; positions go on.
  const auto moved = [](double now, double& last) {
    const double way = now - last;
    last = now;
    return way;
  };
  const double turned = moved(spindle.sample.position, c.turned_rad);
  std::array<double, kAxes> way{};
  Quality quality = spindle.quality;
  for (std::size_t i = 0; i < kAxes; ++i) {
    way[i] = moved(first_->axis(i).sample.position, c.position_m[i]);
    if (i < 2) quality |= first_->axis(i).quality;
  }
  const MonitorState state =
      c.monitor.process(spindle.estimate, turned, first_->axis(0).estimate, way[0],
                        first_->axis(1).estimate, way[1], way[2], quality);
  if (state == c.before) return;
  const auto& now = c.monitor.state();
  changes_.push_back({MonitorId::cutting_coefficients, Channel::tool, state, c.before, now.value,
                      now.threshold, static_cast<std::uint8_t>(now.verdict)});
  c.before = state;
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
  if (tool_spindle_ == Channel::spindle && !second_ && !coefficients_) return of_first;
  changes_.clear();
  add(of_first, tool_spindle_);
  if (coefficients_) hear_cut();
  if (!second_) return changes_;
  const Channel other = other_spindle(tool_spindle_);
  ServoSample<double> second;
  second.t_ns = sample.t_ns;
  second.spindle = sample.drive(other);
  add(second_->process(second), other);
  return changes_;
}

}  // namespace servosense
