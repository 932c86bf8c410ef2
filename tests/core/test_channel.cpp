// Names of channels, quantities and states, there and back; which drive is which.
#include <set>
#include <string_view>

#include "check.hpp"
#include "servosense/core/channel.hpp"
#include "servosense/core/monitor_state.hpp"
#include "servosense/core/servo_sample.hpp"

namespace {

using namespace servosense;

void names_there_and_back() {
  std::set<std::string_view> seen;
  for (std::size_t i = 0; i < kChannelNames.size(); ++i) {
    const auto channel = static_cast<Channel>(i);
    CHECK(channel_from(name_of(channel)) == channel);
    CHECK(seen.insert(name_of(channel)).second);
  }
  seen.clear();
  for (std::size_t i = 0; i < kQuantityNames.size(); ++i) {
    const auto quantity = static_cast<Quantity>(i);
    CHECK(quantity_from(name_of(quantity)) == quantity);
    CHECK(seen.insert(name_of(quantity)).second);
  }
  for (std::size_t i = 0; i < kMonitorStateNames.size(); ++i) {
    const auto state = static_cast<MonitorState>(i);
    CHECK(monitor_state_from(kMonitorStateNames[i]) == state);
    CHECK(name_of(state) == kMonitorStateNames[i]);  // ends where its view does
  }
  CHECK(!channel_from("spindle3"));
  CHECK(!channel_from(""));
  CHECK(!quantity_from("current"));
  CHECK(!monitor_state_from("alarmed"));
  // What traces hold.
  CHECK(name_of(Channel::z2) == "z2");
  CHECK(name_of(Quantity::nc_block) == "nc_block");
  CHECK(name_of(MonitorState::signal_fault) == std::string_view("signal-fault"));
}

void kinds_of_drives() {
  const std::set<Channel> spindles{Channel::spindle, Channel::spindle2};
  const std::set<Channel> linear{Channel::x, Channel::y, Channel::z};
  const std::set<Channel> rotary{Channel::a, Channel::b, Channel::c};
  for (std::size_t i = 0; i < kChannelNames.size(); ++i) {
    const auto c = static_cast<Channel>(i);
    CHECK(is_spindle(c) == spindles.contains(c));
    CHECK(is_axis(c) == (linear.contains(c) || rotary.contains(c)));
    CHECK(is_turning(c) == (spindles.contains(c) || rotary.contains(c)));
    CHECK(is_drive(c) == (spindles.contains(c) || linear.contains(c) || rotary.contains(c)));
  }
  CHECK(other_spindle(Channel::spindle) == Channel::spindle2);
  CHECK(other_spindle(Channel::spindle2) == Channel::spindle);
  CHECK(second_motor_of(Channel::x) == Channel::x2);
  CHECK(second_motor_of(Channel::z) == Channel::z2);
  CHECK(section_of(Channel::b) == "axis.b");
  CHECK(section_of(Channel::spindle2) == "spindle2");
}

// Every drive has a place of its own in the sample of a machine, and the stack of the second
// spindle hears it as its only one.
void places_in_a_sample() {
  MachineServoSample sample;
  double value = 1;
  for (const Channel c : kDriveChannels) sample.drive(c).effort = value++;
  value = 1;
  const MachineServoSample& read = sample;
  for (const Channel c : kDriveChannels) CHECK(read.drive(c).effort == value++);
  CHECK(sample.spindle.effort == 1 && sample.axis[2].effort == 4 && sample.spindle2.effort == 8);
  CHECK(sample.of_spindle(Channel::spindle).spindle.effort == 1);
  const auto second = sample.of_spindle(Channel::spindle2);
  CHECK(second.spindle.effort == 8 && second.axis[5].effort == 7);
  CHECK(sample.spindle.effort == 1);  // the machine's own is as it was
  CHECK((Signal{Channel::x, Quantity::current_A} == Signal{Channel::x, Quantity::current_A}));
  CHECK(!(Signal{Channel::x, Quantity::current_A} == Signal{Channel::y, Quantity::current_A}));
  CHECK(!(Signal{Channel::x, Quantity::current_A} == Signal{Channel::x, Quantity::torque_Nm}));
}

}  // namespace

int main() {
  names_there_and_back();
  kinds_of_drives();
  places_in_a_sample();
  return check::done();
}
