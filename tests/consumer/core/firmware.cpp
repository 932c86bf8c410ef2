// A servo loop that watches one axis for collisions.
#include <servosense/monitors/monitor_stack.hpp>

namespace {
servosense::MonitorStack<float> stack;
}

int main() {
  servosense::MonitorStackConfig config;
  servosense::AxisSlotConfig& x = config.axis[0];
  x.present = true;
  x.input.unit_per_count = 0.016 / 1048576;
  x.input.unit_per_turn = 0.016;
  x.observer.drive.inertia = 227;
  x.monitor_observer = x.observer;
  x.collision.threshold_N_per_s = 14580;
  if (!servosense::MonitorStack<float>::validate(config).ok()) return 1;
  stack.configure(config);
  servosense::ServoSample<float> sample;
  for (int i = 0; i < 1000; ++i) {
    sample.axis[0].counts = 10 * i;
    sample.axis[0].effort = 94.0F;
    stack.process(sample);
  }
  return stack.axis(0).state == servosense::MonitorState::armed ? 0 : 2;
}
