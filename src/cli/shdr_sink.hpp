// `servosense monitor --shdr`: estimates and events for an MTConnect agent.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "arguments.hpp"
#include "servosense/hal/mtconnect.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense::cli {

class ShdrSink {
 public:
  /// Listens where --shdr says, and writes what --shdr-device asks for; does nothing without them.
  Expected<Done> open(const Arguments& arguments, const StackPlan& plan,
                      const std::string& machine);
  void event(Nanoseconds t_ns, const Event& event);
  /// Means over a tenth of a second.
  void sample(Nanoseconds t_ns, const HostStack& stack);

 private:
  std::optional<ShdrServer> server_;
  StackPlan plan_;
  Nanoseconds next_ns_ = 0;
  bool started_ = false;
  std::uint64_t count_ = 0;
  double torque_ = 0, turned_ = 0;  // sums since the last value
  std::array<double, kAxes> force_{};
};

}  // namespace servosense::cli
