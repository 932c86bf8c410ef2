// When every move of a program ends, as if the machine had no inertia.
//
// A feed takes its length over its feed, a rapid what its slowest axis takes at its greatest
// velocity, G33.1 the way there and back. Acceleration, corners, tool changes and the operator take
// no time, so a real run is longer. A planner with a look at what follows has the same shape: moves
// go in one by one, and come out with their time.
#pragma once

#include <array>
#include <functional>
#include <limits>

#include "servosense/process/program/canonical_move.hpp"

namespace servosense::process {

struct RapidLimits {
  /// Greatest velocity of x, y, z [m/s]; infinite where it is not known: the axis then takes no
  /// time.
  std::array<double, 3> velocity_m_s = {std::numeric_limits<double>::infinity(),
                                        std::numeric_limits<double>::infinity(),
                                        std::numeric_limits<double>::infinity()};
};

class PlainTime {
 public:
  using Sink = std::function<void(const CanonicalMove&, double end_s)>;
  PlainTime(const RapidLimits& limits, Sink sink) : limits_(limits), sink_(std::move(sink)) {}

  void put(const CanonicalMove& move);
  /// What is still held back; nothing here.
  void finish() {}
  [[nodiscard]] double now_s() const { return now_s_; }

 private:
  [[nodiscard]] double seconds(const CanonicalMove& move) const;

  RapidLimits limits_;
  Sink sink_;
  AxisPoint machine_{};  // where the machine stands
  double now_s_ = 0;
};

}  // namespace servosense::process
