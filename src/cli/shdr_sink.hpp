// `servosense monitor --shdr`: estimates and events for an MTConnect agent.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "servosense/hal/mtconnect.hpp"
#include "servosense/monitors/machine_stack.hpp"

namespace servosense::cli {

class ShdrSink {
 public:
  /// Listens where --shdr says, and writes what --shdr-device asks for; does nothing without them.
  Expected<Done> open(const Arguments& arguments, const StackPlan& plan,
                      const std::string& machine);
  void event(Nanoseconds t_ns, const Event& event);
  /// Means over a tenth of a second.
  void sample(Nanoseconds t_ns, const MachineStack& stack);

 private:
  std::optional<ShdrServer> server_;
  Nanoseconds next_ns_ = 0;
  bool started_ = false;
  std::uint64_t count_ = 0;
  struct Drive {
    Channel channel;
    double effort = 0, travel = 0;  // sums since the last value
  };
  std::vector<Drive> drives_;
};

}  // namespace servosense::cli
