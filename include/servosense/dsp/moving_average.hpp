// Moving average over a short window.
//
// Purpose: mean of the last N samples; two of them put a null at half the sample rate (Koike 2016,
// ch. 5: the line at 4000 Hz). The first samples average over what has come so far.
//   y = (x[0] + ... + x[N-1]) / N
// Form: direct sum, so nothing drifts; meant for N up to about 16. An input that is no number is
// replaced by its predecessor, and passed over where there is none.
// Delay: (N-1)/2 samples.
// Cost: N additions.
// Numerical bound: that of one sum.
// Bad at: long windows (use MovingVariance's mean).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"

namespace servosense {

template <RealNumber Real, std::size_t Window>
class MovingAverage {
  static_assert(Window >= 1 && Window <= 64);

 public:
  struct State {
    std::array<Real, Window> samples{};
    std::uint32_t count = 0;
    std::uint32_t next = 0;
    Real output = 0;
    bool held = false;  ///< the newest input was no number
  };

  void reset() noexcept { state_ = State{}; }
  Real process(Real x) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.held = !is_finite(x);
    if (s.held) {
      if (s.count == 0) return s.output;
      x = s.samples[(s.next == 0 ? Window : s.next) - 1];
    }
    return advance(x);
  }
  /// process() for a block that has checked its input: `x` must be a number.
  Real advance(Real x) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.samples[s.next] = x;
    s.next = s.next + 1 == Window ? 0 : s.next + 1;
    if (s.count < Window) ++s.count;
    Real sum = 0;
    for (const Real value : s.samples) sum += value;  // those not yet there are zero
    return s.output =
               s.count == Window ? sum * Real(1.0 / Window) : sum / static_cast<Real>(s.count);
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
};

}  // namespace servosense
