// Variance of the last N samples, renewed with every sample at a cost that does not depend on N.
//
// Purpose: power of everything that fluctuates, the mean excluded (Koike 2016, "moving variance").
// Equation: V = E[x^2] - E[x]^2 over the window (Koike 2016, eq. 2-54); with the unnormalised DFT
// H of the window, V = sum over k = 1..N-1 of |H_k|^2 / N^2 (Parseval; the printed eq. 2-51 misses
// a factor 1/N). A sinusoid of amplitude A gives A^2 / 2.
// Discretisation: none, samples count alike. Sums over the window take what enters and give up what
// leaves; beside them others fill with what enters. Once in N samples those hold the whole window:
// they take the place of the first and begin anew. No rounding error lives longer than two windows.
// All count from a shift, the mean of the window at that time, so an offset costs no digits.
// Delay: (N-1)/2 samples for a change of power. Settled after N samples; until then the variance
// of what has arrived.
// Cost: 47 instructions on Cortex-M4F, 89 for the worst sample (the sums begin anew once in N),
// independent of N; 4 N bytes in float.
// Range: |x| < 1e15, else the sample counts as invalid; N from 2 to Capacity.
// Numerical bound: error below 8 N^(1/2) u (V + d^2), u = 6e-8 in float, d the largest distance of
// a sample of the last two windows from the shift; the same after 24 h as after one window.
// Bad at: a step of the mean inside the window counts as power until it has left; after a step of
// more than 1000 standard deviations the result is only good again after two windows.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"

namespace servosense {

/// Largest magnitude whose square, summed over any window, is finite in float.
inline constexpr double kLargestWindowSample = 1e15;

/// False for NaN, Inf and numbers whose square would spoil a sum.
template <RealNumber Real>
[[nodiscard]] inline bool fits_window(Real x) noexcept {
  return std::abs(x) < static_cast<Real>(kLargestWindowSample);
}

struct MovingVarianceConfig {
  std::size_t window_samples = 512;
};

template <RealNumber Real>
struct MovingVarianceState {
  Real variance = 0;
  Real mean = 0;
  Real shift = 0;   ///< the sums count from here
  Real sum = 0;     ///< of x - shift over the window
  Real square = 0;  ///< of (x - shift)^2
  Real fill = 0;    ///< both of what has entered since they began anew
  Real fill_square = 0;
  std::uint32_t samples = 0;  ///< in the window
  std::uint64_t held = 0;     ///< samples replaced by their predecessor because they were invalid
  std::uint64_t clamps = 0;   ///< results that rounding had made negative, given as 0
  bool settled = false;       ///< the window is full
  bool input_held = false;    ///< the newest sample was such a stand-in
};

/// Moving variance over memory of the caller, which must outlive it.
template <RealNumber Real>
class MovingVarianceView {
 public:
  using Config = MovingVarianceConfig;
  using State = MovingVarianceState<Real>;

  explicit MovingVarianceView(std::span<Real> memory) noexcept : memory_(memory) {}

  [[nodiscard]] static Status validate(const Config& c, std::size_t capacity) noexcept {
    if (c.window_samples < 2) return Status::invalid("window_samples", "must be at least 2");
    if (c.window_samples > capacity)
      return Status::invalid("window_samples", "must not exceed the memory of the block");
    return {};
  }
  [[nodiscard]] Status validate(const Config& c) const noexcept {
    return validate(c, memory_.size());
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    window_ = c.window_samples;
    reset();
  }
  void reset() noexcept {
    state_ = State{};
    at_ = end_ = 0;
    inverse_ = 0;
  }

  /// Variance of the window that ends with `x`, in the unit of x squared; never negative.
  Real process(Real x) SERVOSENSE_NONBLOCKING { return step(memory_.data(), x); }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  template <RealNumber, std::size_t>
  friend class MovingVariance;
  MovingVarianceView() noexcept = default;

  // The everyday sample of a full window; the full path gives the same.
  [[gnu::always_inline]] Real step(Real* memory, Real x) noexcept {
    if (at_ >= end_ || !fits_window(x)) return step_in_full(memory, x);
    state_.input_held = false;
    return exchange(memory, x);
  }
  // `x` for the oldest of a full window.
  [[gnu::always_inline]] Real exchange(Real* memory, Real x) noexcept {
    State& s = state_;
    const Real out = memory[at_] - s.shift;
    memory[at_++] = x;
    const Real in = x - s.shift;
    s.fill += in;
    s.fill_square += in * in;
    s.sum += in - out;
    s.square += (in - out) * (in + out);
    return conclude();
  }
  [[gnu::always_inline]] Real conclude() noexcept {
    State& s = state_;
    const Real mean = s.sum * inverse_;
    const Real variance = s.square * inverse_ - mean * mean;
    s.mean = s.shift + mean;
    return s.variance = variance >= 0 ? variance : clamp();
  }
  [[gnu::noinline]] Real clamp() noexcept {
    ++state_.clamps;
    return Real(0);
  }

  [[gnu::noinline]] Real step_in_full(Real* memory, Real x) noexcept {
    State& s = state_;
    s.input_held = !fits_window(x);
    if (s.input_held) {
      ++s.held;
      if (s.samples == 0) return s.variance;
      x = memory[(at_ == 0 ? window_ : at_) - 1];
    }
    if (at_ == window_) turn_over(x);
    if (end_ != 0) return exchange(memory, x);
    if (s.samples == 0) s.shift = x;
    memory[at_++] = x;
    const Real in = x - s.shift;
    s.sum = s.fill += in;
    s.square = s.fill_square += in * in;
    inverse_ = Real(1) / static_cast<Real>(++s.samples);
    s.settled = s.samples == window_;
    return conclude();
  }
  // The ring begins again, with what fills: all that is in it.
  void turn_over(Real x) noexcept {
    State& s = state_;
    // Without what rounding has left of the samples that have gone. Behind a step that is far from
    // exact, and a sample within its rounding nearer.
    Real mean = s.shift + s.fill * inverse_;
    if (std::abs(x - mean) < Real(1e-5) * std::abs(s.fill * inverse_)) mean = x;
    const Real apart = s.shift - mean;
    const Real moved = static_cast<Real>(s.samples) * apart;
    s.square = s.fill_square + apart * (s.fill + s.fill + moved);
    s.sum = s.fill + moved;
    s.fill = s.fill_square = 0;
    s.shift = mean;
    at_ = 0;
    end_ = window_;
  }

  State state_;
  std::span<Real> memory_;
  std::size_t window_ = 0;
  std::size_t at_ = 0;   // next place in the ring
  std::size_t end_ = 0;  // of the ring, once it has been full
  Real inverse_ = 0;     // 1 / samples in the window
};

/// Moving variance with its own memory.
template <RealNumber Real, std::size_t Capacity>
class MovingVariance {
 public:
  using Config = MovingVarianceConfig;
  using State = MovingVarianceState<Real>;

  [[nodiscard]] static Status validate(const Config& c) noexcept {
    return MovingVarianceView<Real>::validate(c, Capacity);
  }
  void configure(const Config& c) noexcept { window_.configure(c); }
  void reset() noexcept { window_.reset(); }
  /// Variance of the window that ends with `x`, in the unit of x squared; never negative.
  Real process(Real x) SERVOSENSE_NONBLOCKING { return window_.step(memory_.data(), x); }
  [[nodiscard]] const State& state() const noexcept { return window_.state(); }

 private:
  MovingVarianceView<Real> window_;
  std::array<Real, Capacity> memory_{};
};

}  // namespace servosense
