// Up to which speed the torque constant of the spindle is known, and what turned faster.
//
// An idling run shows the constant as far as it accelerates. A motor that is run beyond its base
// speed gives less torque per ampere, so faster than that the current says nothing sure of the
// torque: the estimate is left out, and the verdict says so.
#pragma once

#include <cstdint>
#include <vector>

#include "servosense/dsp/first_order.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "verdict.hpp"

namespace servosense::cli {

class KnownTorque {
 public:
  KnownTorque(const StackPlan& plan, double sample_period_s);
  /// Whether the constant is known at the speed of this sample.
  bool sample(double increment_rad, bool recorded);
  [[nodiscard]] bool known() const { return known_; }
  /// Adds what was beyond to the reasons of the monitors that hear the spindle, and to what they
  /// did not watch.
  void tell(StackPlan& plan, std::vector<Watched>& watched) const;

 private:
  double period_s_;
  double limit_rad_s_ = 0;  // 0: none
  double known_to_rad_s_ = 0;
  LowPass<double> speed_;  // counts come in steps
  bool known_ = true;
  std::uint64_t beyond_ = 0;
  double fastest_rad_s_ = 0;
};

}  // namespace servosense::cli
