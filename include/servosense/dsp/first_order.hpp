// First-order low-pass and pseudo-derivative.
//
// Purpose: the two filters every disturbance observer is made of.
//   low-pass           Y/X = g/(s+g)
//   pseudo-derivative  Y/X = s g/(s+g)          (Koike 2016, eq. 2-11 and 2-23)
// Discretisation: Tustin by default,
//   low-pass          y += c (x + x_last - 2 y),            c = gT/(2+gT)
//   pseudo-derivative y += k (dx/T - y),                    k = 2gT/(2+gT), dx = x - x_last
// or backward Euler, c = k = gT/(1+gT) on the newest value only. They agree far below the cutoff
// and differ near it: at g = 4000 rad/s and 8 kHz backward Euler passes a third less encoder
// quantisation noise (22.6 N against 35.0 N on Koike's Z stage) and lags more. Written as
// corrections of y, both forms have a gain of exactly one at rest, in float too. No prewarping: g
// is a physical cutoff. The pseudo-derivative takes the increment dx, not x, so it stays exact
// however large x has grown.
// Delay: 1/(gT) samples at low frequency.
// Cost: see bench/firmware/instructions.csv (low_pass, pseudo_derivative).
// Range: 0 < gT < 2 for a damped Tustin response without sign changes.
// Numerical bound: contraction; errors do not accumulate. A result that is not finite is not taken:
// the last one stands.
// Bad at: cutoffs below 1e-6 of the sample rate in float, where the correction falls below the
// rounding of y.
#pragma once

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"

namespace servosense {

enum class Discretisation : unsigned char { tustin, backward_euler };

struct FirstOrderConfig {
  double cutoff_rad_s = 0;
  double sample_period_s = 125e-6;
  Discretisation discretisation = Discretisation::tustin;
};

[[nodiscard]] constexpr Status validate_first_order(const FirstOrderConfig& c) noexcept {
  if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
  if (!(c.cutoff_rad_s > 0)) return Status::invalid("cutoff_rad_s", "must be positive");
  if (c.discretisation == Discretisation::tustin && !(c.cutoff_rad_s * c.sample_period_s < 2))
    return Status::invalid("cutoff_rad_s", "must be below 2 / sample period");
  return {};
}

template <RealNumber Real>
class LowPass {
 public:
  using Config = FirstOrderConfig;
  struct State {
    Real input = 0;
    Real output = 0;
    bool held = false;  ///< the newest input was no number; the output before it is repeated
  };

  static Status validate(const Config& c) noexcept { return validate_first_order(c); }
  void configure(const Config& c) noexcept {
    const double gT = c.cutoff_rad_s * c.sample_period_s;
    const bool tustin = c.discretisation == Discretisation::tustin;
    newest_ = static_cast<Real>(tustin ? gT / (2 + gT) : gT / (1 + gT));
    last_ = tustin ? newest_ : Real(0);
    reset();
  }
  void reset() noexcept { state_ = State{}; }
  /// Starts as if `value` had been the input for ever.
  void prime(Real value) noexcept { state_ = State{value, value, false}; }

  Real process(Real x) SERVOSENSE_NONBLOCKING {
    const Real y = state_.output;
    const Real next = y + newest_ * (x - y) + last_ * (state_.input - y);
    state_.held = !is_finite(next);
    if (state_.held) return y;
    state_.input = x;
    return state_.output = next;
  }
  /// process() for a block that has checked its input: `x` must be a number of moderate size.
  Real advance(Real x) SERVOSENSE_NONBLOCKING {
    const Real y = state_.output;
    state_.output = y + newest_ * (x - y) + last_ * (state_.input - y);
    state_.input = x;
    return state_.output;
  }
  /// advance(), with `offset` added to the output; it decays from there.
  Real advance(Real x, Real offset) SERVOSENSE_NONBLOCKING {
    const Real y = state_.output;
    state_.output = y + newest_ * (x - y) + last_ * (state_.input - y) + offset;
    state_.input = x;
    return state_.output;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  Real newest_ = 0;
  Real last_ = 0;
};

template <RealNumber Real>
class PseudoDerivative {
 public:
  using Config = FirstOrderConfig;
  struct State {
    Real output = 0;
    bool held = false;  ///< as for LowPass
  };

  static Status validate(const Config& c) noexcept { return validate_first_order(c); }
  void configure(const Config& c) noexcept {
    const double gT = c.cutoff_rad_s * c.sample_period_s;
    gain_ = static_cast<Real>(c.discretisation == Discretisation::tustin ? 2 * gT / (2 + gT)
                                                                         : gT / (1 + gT));
    rate_ = static_cast<Real>(1 / c.sample_period_s);
    reset();
  }
  void reset() noexcept { state_ = State{}; }
  /// Starts as if the input had always changed by `increment` a sample.
  void prime(Real increment) noexcept { state_.output = increment * rate_; }

  /// `increment` is the change of the input since the last sample; returns its rate per second.
  Real process(Real increment) SERVOSENSE_NONBLOCKING {
    const Real next = state_.output + gain_ * (increment * rate_ - state_.output);
    state_.held = !is_finite(next);
    return state_.held ? state_.output : state_.output = next;
  }
  /// process() for a block that has checked its input: a number of moderate size.
  Real advance(Real increment) SERVOSENSE_NONBLOCKING {
    return state_.output += gain_ * (increment * rate_ - state_.output);
  }
  /// What one unit of increment adds to the output.
  [[nodiscard]] Real step() const noexcept { return gain_ * rate_; }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  Real gain_ = 0;
  Real rate_ = 0;
};

}  // namespace servosense
