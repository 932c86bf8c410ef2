// The torque constants of a run, checked by its accelerations (identify/constant_check.hpp): a
// drift is told once, as a warning of the monitor `signal`, and what was seen at the end.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "known_torque.hpp"
#include "servosense/identify/constant_check.hpp"
#include "servosense/io/event.hpp"
#include "servosense/monitors/machine_stack.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense::cli {

class ConstantWatch {
 public:
  ConstantWatch(const MachineFile& machine, const StackPlan& plan);
  struct Change {
    StateChange<double> change;
    Event event;
  };
  /// Changes that this sample brings.
  [[nodiscard]] std::vector<Change> sample(double t_s, const MachineStack& stack,
                                           const KnownTorque& known);
  struct Finding {
    Channel channel = Channel::spindle;
    ConstantDrift drift;
  };
  /// Of the drives that accelerated often enough.
  [[nodiscard]] std::vector<Finding> findings() const;
  [[nodiscard]] std::vector<std::string> remarks() const;

 private:
  struct Drive {
    Channel channel;
    ConstantCheck check;
    std::size_t heard = 0;  // pairs
    bool told = false;
  };
  std::vector<Drive> drives_;
};

}  // namespace servosense::cli
