// README's snippet for firmware, compiled and run as it stands there: it finds a contact, and says
// signal-fault before it is started.
#include <cmath>
#include <cstdint>

#include "check.hpp"
#include "servosense/core/servo_sample.hpp"

namespace {

std::int64_t counts = 0;
float current_A = 0;
int holds = 0;

servosense::ServoSample<float> read_drives() {
  servosense::ServoSample<float> sample;
  sample.axis[0].counts = counts;
  sample.axis[0].effort = current_A;
  return sample;
}
void hold_feed() { ++holds; }

}  // namespace

#include "readme_firmware.hpp"

int main() {
  servo_interrupt();
  CHECK(holds == 0);
  CHECK(stack.axis(0).signal == servosense::MonitorState::signal_fault);
  CHECK(start_watching());
  // 0.1 m/s; after two seconds a contact that rises by 400 kN/s for 10 ms.
  const double force_N_per_A = 314, velocity_m_s = 0.1;
  double held_s = -1;
  for (int n = 0; n < 24000; ++n) {
    const double t = 125e-6 * n;
    const double contact_N = t > 2 ? std::fmin(4000.0, 4e5 * (t - 2)) : 0;
    counts = static_cast<std::int64_t>(velocity_m_s * t / 0.016 * 1048576);
    current_A = static_cast<float>((94 + 732 * velocity_m_s + contact_N) / force_N_per_A);
    servo_interrupt();
    if (holds > 0 && held_s < 0) held_s = t;
  }
  CHECK_BETWEEN(held_s, 2.0, 2.003);
  return check::done();
}
