// Moving threshold: is this value large beside the last few?
//
// Purpose: decides on residuals without a level taught for the cut.
//   R(k)^2 = x(k)^2 / (mean of x^2 over the n values before k + floor^2)
// (Bertok 1984, eq. 5.18-5.19, where the window also leaves out the value judged.) The floor keeps
// a stretch of exact zeros from making everything after it an event; it is the noise of x. n = 10
// after the study: fewer make R restless, more let entries shrink the peak.
// Delay: none.
// Cost: n + 10 instructions and a division.
// Numerical bound: direct sum, no drift.
// Range: |x| < 1e15. A value that is no number gives 0 and is not remembered.
// Bad at: slowly growing changes, which raise their own threshold; of two events less than n apart
// the second is judged by the first.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"

namespace servosense {

struct MovingThresholdConfig {
  unsigned window = 10;  ///< n
  double floor = 0;      ///< standard deviation that the window never falls below; above 0
};

template <RealNumber Real, std::size_t MaxWindow>
class MovingThreshold {
  static_assert(MaxWindow >= 1);

 public:
  using Config = MovingThresholdConfig;
  struct State {
    Real ratio_squared = 0;   ///< R(k)^2; 0 until the window is full
    std::uint32_t count = 0;  ///< values in the window
    std::uint32_t next = 0;
    std::array<Real, MaxWindow> squares{};
  };

  static Status validate(const Config& c) noexcept {
    if (c.window < 1 || c.window > MaxWindow)
      return Status::invalid("window", "must be within 1 and the block's capacity");
    if (!(c.floor > 0 && c.floor < 1e15)) return Status::invalid("floor", "must be positive");
    return {};
  }
  void configure(const Config& c) noexcept {
    window_ = c.window;
    n_ = static_cast<Real>(c.window);
    floor_ = static_cast<Real>(c.floor * c.floor * c.window);
    reset();
  }
  void reset() noexcept {
    state_.ratio_squared = 0;
    state_.count = state_.next = 0;
  }

  /// R(k)^2 of this value.
  Real process(Real x) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    if (!(x < Real(1e15) && x > Real(-1e15))) return s.ratio_squared = 0;
    const Real square = x * x;
    Real sum = floor_;
    for (std::uint32_t i = 0; i < window_; ++i) sum += s.squares[i];
    s.ratio_squared = s.count == window_ ? n_ * square / sum : Real(0);
    s.squares[s.next] = square;
    s.next = s.next + 1 == window_ ? 0 : s.next + 1;
    s.count += s.count < window_;
    return s.ratio_squared;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  std::uint32_t window_ = 1;
  Real n_ = 1;
  Real floor_ = 1;
};

}  // namespace servosense
