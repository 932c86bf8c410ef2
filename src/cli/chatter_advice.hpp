// What a chatter alarm means for the machinist: its frequency, and spindle speeds to try.
#pragma once

#include <string>

#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense::cli {

class ChatterAdvice {
 public:
  /// Takes [tool] teeth and the modes of [structure.*], as far as they are there.
  ChatterAdvice(const MachineFile& machine, const StackPlan& plan);

  /// A clause to follow the alarm's reason, from the evidence that `stack` still holds; empty when
  /// no line stands out.
  [[nodiscard]] std::string clause(const HostStack& stack) const;

 private:
  ChatterConfig chatter_;
  DisturbanceObserverConfig observer_;
  unsigned teeth_ = 0;
  std::vector<double> natural_hz_;
};

}  // namespace servosense::cli
