// Moving threshold: is this value large beside the last few?
//
// Purpose: decides on residuals without a level taught for the cut.
//   R(k)^2 = (x(k)^2 + ... + x(k-q+1)^2) / (mean of x^2 over the n values before those + floor^2)
// (Bertok 1984, eq. 5.18-5.19, where q = 1 and the window also leaves out the value judged.) With q
// above 1 an event is found that takes q samples and whose first one would hide the others. The
// floor keeps a stretch of exact zeros from making everything after it an event; it is the noise of
// x. n = 10 after the study: fewer make R restless, more let entries shrink the peak. Of white
// Gaussian noise R^2 / q is an F(q, n) variate.
// Delay: none.
// Cost: n + q + 18 instructions and two divisions.
// Numerical bound: direct sums, no drift.
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
  unsigned judged = 1;   ///< q, newest values that are judged together
};

template <RealNumber Real, std::size_t MaxWindow, std::size_t MaxJudged = 1>
class MovingThreshold {
  static_assert(MaxWindow >= 1 && MaxJudged >= 1);

 public:
  using Config = MovingThresholdConfig;
  struct State {
    Real ratio_squared = 0;   ///< R(k)^2; 0 until the window is full
    Real newest_squared = 0;  ///< x(k)^2 over the mean of all n + q - 1 before it; 0 likewise
    std::uint32_t count = 0;  ///< values so far, stops when window and judged ones are full
    std::uint32_t next = 0;
    std::uint32_t next_judged = 0;
    std::array<Real, MaxWindow> squares{};
    std::array<Real, MaxJudged> judged{};  // squares that are not in the window yet
  };

  static Status validate(const Config& c) noexcept {
    if (c.window < 1 || c.window > MaxWindow)
      return Status::invalid("window", "must be within 1 and the block's capacity");
    if (c.judged < 1 || c.judged > MaxJudged)
      return Status::invalid("judged", "must be within 1 and the block's capacity");
    if (!(c.floor > 0 && c.floor < 1e15)) return Status::invalid("floor", "must be positive");
    return {};
  }
  void configure(const Config& c) noexcept {
    window_ = c.window;
    judged_ = c.judged;
    n_ = static_cast<Real>(c.window);
    all_ = static_cast<Real>(c.window + c.judged - 1);
    floor_ = static_cast<Real>(c.floor * c.floor * c.window);
    reset();
  }
  void reset() noexcept {
    state_.ratio_squared = state_.newest_squared = 0;
    state_.count = state_.next = state_.next_judged = 0;
  }

  /// R(k)^2 of this value.
  Real process(Real x) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    if (!(x < Real(1e15) && x > Real(-1e15))) return s.ratio_squared = s.newest_squared = 0;
    // The oldest one judged moves into the window. What the rings hold from before a reset has left
    // them by the time the count is complete.
    s.squares[s.next] = s.judged[s.next_judged];
    s.next = s.next + 1 == window_ ? 0 : s.next + 1;
    s.judged[s.next_judged] = 0;
    s.count += s.count < window_ + judged_;
    Real before = floor_;
    Real others = 0;
    for (std::uint32_t i = 0; i < window_; ++i) before += s.squares[i];
    for (std::uint32_t i = 0; i < judged_; ++i) others += s.judged[i];
    const Real square = x * x;
    s.judged[s.next_judged] = square;
    s.next_judged = s.next_judged + 1 == judged_ ? 0 : s.next_judged + 1;
    if (s.count < window_ + judged_) return s.ratio_squared = s.newest_squared = 0;
    s.newest_squared = all_ * square / (before + others);
    s.ratio_squared = n_ * (others + square) / before;
    return s.ratio_squared;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  std::uint32_t window_ = 1;
  std::uint32_t judged_ = 1;
  Real n_ = 1;
  Real all_ = 1;
  Real floor_ = 1;
};

}  // namespace servosense
