// Limit pattern: what a cycle has shown at each of its intervals, the limits of the next one.
//
// Purpose: teaching (Tarng 1988, sec. 7.2): the least and greatest value of each interval of a
// cycle without fault, scaled by a factor, bound the same interval of later cycles. An interval is
// judged by its neighbours too, so that a cycle may shift by one interval. Source leaves interval
// and alignment open. Here the caller counts: by revolutions of the spindle (then speed does not
// matter), time or program block.
// Cost: 10 instructions to record, 30 to look up.
// Delay: none. Nothing sums up, nothing drifts.
// Bad at: cycles that shift by more than an interval; a fault in the taught cycle.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"

namespace servosense {

template <RealNumber Real, std::size_t Intervals>
class LimitPattern {
  static_assert(Intervals >= 1);

 public:
  struct Limits {
    Real low = 0;  ///< at or below 0
    Real high = 0;
    bool taught = false;
  };
  struct State {
    std::array<Real, Intervals> low{};
    std::array<Real, Intervals> high{};
    std::uint32_t intervals = 0;  ///< taught so far; later ones have no limits
  };

  void reset() noexcept { state_ = State{}; }

  /// Widens interval `at` by a value. False when it lies beyond the capacity, or value is no
  /// number.
  bool record(std::uint32_t at, Real value) SERVOSENSE_NONBLOCKING {
    if (at >= Intervals || !is_finite(value)) return false;
    State& s = state_;
    // Intervals that were passed over had nothing to show: they were reset to 0.
    if (at >= s.intervals) s.intervals = at + 1;
    if (value < s.low[at]) s.low[at] = value;
    if (value > s.high[at]) s.high[at] = value;
    return true;
  }
  /// Widest of interval `at` and its neighbours.
  [[nodiscard]] Limits limits(std::uint32_t at) const SERVOSENSE_NONBLOCKING {
    const State& s = state_;
    Limits l;
    if (at >= s.intervals) return l;
    const std::uint32_t first = at > 0 ? at - 1 : 0;
    const std::uint32_t last = at + 1 < s.intervals ? at + 1 : at;
    for (std::uint32_t i = first; i <= last; ++i) {
      if (s.low[i] < l.low) l.low = s.low[i];
      if (s.high[i] > l.high) l.high = s.high[i];
    }
    l.taught = true;
    return l;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
};

}  // namespace servosense
