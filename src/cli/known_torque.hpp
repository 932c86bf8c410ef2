// Up to which speed the torque constant of a spindle is known, and what turned faster.
//
// An idling run shows the constant as far as it accelerates. A motor that is run beyond its base
// speed gives less torque per ampere, so faster than that the current says nothing sure of the
// torque: the estimate is left out, and the verdict says so.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "servosense/dsp/first_order.hpp"
#include "servosense/monitors/machine_stack.hpp"
#include "verdict.hpp"

namespace servosense::cli {

class KnownTorque {
 public:
  KnownTorque(const StackPlan& plan, double sample_period_s);
  void sample(const MachineStack& stack, bool recorded);
  /// Whether the torque constant of this drive is known at its present speed.
  [[nodiscard]] bool known(Channel drive) const;
  /// Adds what was beyond to the reasons of the monitors that hear the spindle, and to what they
  /// did not watch.
  void tell(StackPlan& plan, std::vector<Watched>& watched) const;

 private:
  struct Spindle {
    Channel channel = Channel::spindle;
    double known_to_rad_s = 0;  // 0: at any speed
    LowPass<double> speed;      // counts come in steps
    bool known = true;
    std::uint64_t beyond = 0;
    double fastest_rad_s = 0;
  };
  double period_s_;
  std::array<Spindle, 2> spindles_;
};

}  // namespace servosense::cli
