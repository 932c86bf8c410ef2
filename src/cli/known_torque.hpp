// At which speeds the effort of a spindle tells its torque, and what turned faster or slower.
//
// An idling run shows the torque constant as far as it accelerates. A motor that is run beyond its
// base speed gives less torque per ampere, so faster than that the current says nothing sure of the
// torque. A power tells the torque from some speed on, and nothing at rest. The estimate is left
// out there, and the verdict says so: of a power where a tenth of the turning was too slow, since
// every run-up passes there.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "servosense/dsp/first_order.hpp"
#include "servosense/hal/sample_source.hpp"
#include "servosense/monitors/machine_stack.hpp"
#include "verdict.hpp"

namespace servosense::cli {

class KnownTorque {
 public:
  KnownTorque(const StackPlan& plan, const SampleSource& source);
  void sample(const MachineStack& stack, bool recorded);
  /// Whether the effort of this drive tells its torque at its present speed.
  [[nodiscard]] bool known(Channel drive) const;
  /// Adds what was beyond to the reasons of the monitors that hear the spindle, and to what they
  /// did not watch.
  void tell(StackPlan& plan, std::vector<Watched>& watched) const;

 private:
  struct Spindle {
    Channel channel = Channel::spindle;
    double known_to_rad_s = 0;    // 0: at any speed
    double known_from_rad_s = 0;  // likewise
    LowPass<double> speed;        // counts come in steps
    bool known = true;
    std::uint64_t beyond = 0;
    double fastest_rad_s = 0;
    std::uint64_t turning = 0, slow = 0;  // samples of a power, and those too slow for it
  };
  void tell(const Spindle& s, const std::string& known, const std::string& sentence,
            StackPlan& plan, std::vector<Watched>& watched) const;
  double period_s_;
  std::array<Spindle, 2> spindles_;
};

}  // namespace servosense::cli
