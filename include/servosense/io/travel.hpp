// Readings of a motion column as a way that goes on: counters wrap, and an angle may begin anew
// with every turn.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "servosense/core/units.hpp"
#include "servosense/io/trace.hpp"

namespace servosense {

enum class Reading : std::uint8_t { plain, angle, counts };

class Travel {
 public:
  Travel() = default;
  /// `counter_bits` 1..64, of counts.
  explicit Travel(Reading reading, unsigned counter_bits = 32)
      : reading_(reading), spare_bits_(64 - counter_bits) {}

  /// A field that holds a value. Counts: the way since the first [counts]; an angle with the whole
  /// turns added; anything else as it is.
  double add(const TraceField& field) {
    double out = field.value;
    if (reading_ == Reading::angle) {
      if (started_) turns_ += turns_between(angle_, field.value);
      angle_ = field.value;
      out += kTwoPi * turns_;
    } else if (reading_ == Reading::counts) {
      // The nearest way round.
      const auto step =
          static_cast<std::uint64_t>(field.counts) - static_cast<std::uint64_t>(counts_);
      if (started_)
        way_ += static_cast<double>(static_cast<std::int64_t>(step << spare_bits_) >> spare_bits_);
      counts_ = field.counts;
      out = way_;
    }
    started_ = true;
    return out;
  }

 private:
  /// A step of more than half a turn between two values of the same turn is one back, or ahead.
  static double turns_between(double last, double now) {
    const auto within = [&](double low) {
      constexpr double kRounding = 0.01;
      return std::min(last, now) > low - kRounding &&
             std::max(last, now) < low + kTwoPi + kRounding;
    };
    if (std::abs(now - last) <= kPi || !(within(0) || within(-kPi))) return 0;
    return now < last ? 1 : -1;
  }

  Reading reading_ = Reading::plain;
  unsigned spare_bits_ = 32;
  double angle_ = 0, turns_ = 0;
  std::int64_t counts_ = 0;
  double way_ = 0;
  bool started_ = false;
};

}  // namespace servosense
