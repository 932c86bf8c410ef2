// Biquad: second-order recursive filter.
//
// Purpose: the section that notches and resonance filters are made of.
//   H(z) = (b0 + b1 z^-1 + b2 z^-2) / (1 + a1 z^-1 + a2 z^-2)
// Form: transposed direct form II, coefficients apart from state:
//   y = b0 x + s1;  s1 = b1 x - a1 y + s2;  s2 = b2 x - a2 y
// A step whose result is not finite is not taken: the last output stands.
// Delay: that of the design.
// Cost: bench/firmware/instructions.csv (biquad).
// Range: poles inside the unit circle, |a2| < 1 and |a1| < 1 + a2.
// Numerical bound: errors decay with the poles; nothing accumulates.
// Bad at: poles closer to z = 1 than about 1e-3 in float (coefficient rounding).
#pragma once

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"

namespace servosense {

struct BiquadConfig {
  double b0 = 1;
  double b1 = 0;
  double b2 = 0;
  double a1 = 0;
  double a2 = 0;
};

template <RealNumber Real>
class Biquad {
 public:
  using Config = BiquadConfig;
  struct State {
    Real s1 = 0;
    Real s2 = 0;
    Real output = 0;
    bool held = false;  ///< the newest input was no number; the output before it is repeated
  };

  static Status validate(const Config& c) noexcept {
    if (!is_finite(c.b0) || !is_finite(c.b1) || !is_finite(c.b2))
      return Status::invalid("b0", "numerator must be finite");
    if (!(c.a2 < 1 && c.a2 > -1)) return Status::invalid("a2", "must be within -1 and 1");
    if (!(c.a1 < 1 + c.a2 && c.a1 > -1 - c.a2))
      return Status::invalid("a1", "must be within -(1 + a2) and 1 + a2");
    return {};
  }
  void configure(const Config& c) noexcept {
    b0_ = static_cast<Real>(c.b0);
    b1_ = static_cast<Real>(c.b1);
    b2_ = static_cast<Real>(c.b2);
    a1_ = static_cast<Real>(c.a1);
    a2_ = static_cast<Real>(c.a2);
    reset();
  }
  void reset() noexcept { state_ = State{}; }
  /// Starts as if `value` had been the input for ever.
  void prime(Real value) noexcept {
    const Real y = value * (b0_ + b1_ + b2_) / (Real(1) + a1_ + a2_);
    const Real s2 = b2_ * value - a2_ * y;
    state_ = State{b1_ * value - a1_ * y + s2, s2, y, false};
  }

  Real process(Real x) SERVOSENSE_NONBLOCKING {
    const Real y = b0_ * x + state_.s1;
    const Real s1 = b1_ * x - a1_ * y + state_.s2;
    const Real s2 = b2_ * x - a2_ * y;
    state_.held = !is_finite(y + s1 + s2);
    if (state_.held) return state_.output;
    state_.s1 = s1;
    state_.s2 = s2;
    return state_.output = y;
  }
  /// process() for a block that has checked its input: `x` must be a number of moderate size.
  Real advance(Real x) SERVOSENSE_NONBLOCKING {
    const Real y = b0_ * x + state_.s1;
    state_.s1 = b1_ * x - a1_ * y + state_.s2;
    state_.s2 = b2_ * x - a2_ * y;
    return state_.output = y;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  Real b0_ = 1;
  Real b1_ = 0;
  Real b2_ = 0;
  Real a1_ = 0;
  Real a2_ = 0;
};

}  // namespace servosense
