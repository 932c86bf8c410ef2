// When the spindle has the speed that the program asks for: it takes a while after M3, M4 or
// another S, and the control goes on meanwhile unless it waits for it.
//
// From standing to any speed takes `start_s`, as a drive with a ramp of its own takes to its
// highest; a change of speed takes the share of that which it is of the higher speed, a reversal
// up to twice as long. How long it takes to stand is not counted.
#pragma once

#include <algorithm>
#include <cmath>

#include "servosense/process/program/canonical_move.hpp"

namespace servosense::process {

class SpindleStart {
 public:
  /// A change of speed up to this share of it is none (chosen: what "at speed" of a drive allows).
  static constexpr double kSameSpeed = 0.1;

  /// `start_s`: 0 or more [s].
  explicit SpindleStart(double start_s) : start_s_(start_s) {}

  /// A move that begins at `now_s`; the spindle's speed changes with what is no motion.
  void put(const CanonicalMove& move, double now_s) {
    if (is_motion(move.kind) || move.spindle_rpm == rpm_) return;
    const double highest = std::max(std::abs(rpm_), std::abs(move.spindle_rpm));
    const double change = std::abs(move.spindle_rpm - rpm_) / highest;
    rpm_ = move.spindle_rpm;
    if (rpm_ == 0)
      ready_s_ = 0;
    else if (change > kSameSpeed)
      ready_s_ = std::max(ready_s_, now_s + change * start_s_);
  }
  /// When it has its speed; 0 of one that stands.
  [[nodiscard]] double ready_s() const { return ready_s_; }

 private:
  double start_s_, rpm_ = 0, ready_s_ = 0;
};

}  // namespace servosense::process
