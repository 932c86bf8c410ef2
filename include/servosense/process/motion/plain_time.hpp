// When every move of a program ends, as if the machine had no inertia: where accelerations are not
// known (`trajectory.hpp` where they are).
//
// A feed takes its length over its feed, a rapid what its slowest axis takes at its greatest
// velocity, no time where that is not known, G33.1 the way there and back; feeds wait for the
// spindle if `spindle_start_s` says so. Acceleration, corners and operator take no time, so a real
// run is longer.
#pragma once

#include <functional>

#include "servosense/process/motion/motion_limits.hpp"
#include "servosense/process/motion/spindle_start.hpp"
#include "servosense/process/program/canonical_move.hpp"

namespace servosense::process {

class PlainTime {
 public:
  using Sink = std::function<void(const CanonicalMove&, double end_s)>;
  PlainTime(const MotionLimits& limits, Sink sink)
      : limits_(limits), sink_(std::move(sink)), spindle_(limits.spindle_start_s) {}

  void put(const CanonicalMove& move);
  /// What is still held back; nothing here.
  void finish() {}
  [[nodiscard]] double now_s() const { return now_s_; }

 private:
  [[nodiscard]] double seconds(const CanonicalMove& move) const;

  MotionLimits limits_;
  Sink sink_;
  SpindleStart spindle_;
  AxisPoint machine_{};  // where the machine stands
  double now_s_ = 0;
};

}  // namespace servosense::process
