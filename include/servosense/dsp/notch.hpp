// Notch: takes one line out and leaves the rest.
//
// Purpose: removes the lines that the sampling structure of a controller puts on the force estimate
// (Koike 2016, ch. 5: 1000 and 2000 Hz at 8 kHz with a 2 kHz current update).
//   H(s) = (s^2 + w0^2) / (s^2 + s w0/Q + w0^2)
// Discretisation: bilinear, prewarped at w0, so that the null lies exactly on the line:
//   k = tan(w0 T / 2), b = (1 + k^2) / n [1, -2 cos(w0 T), 1], a2 = (1 - k/Q + k^2) / n, n = 1 +
//   k/Q + k^2
//   b0 = b2 and b1 = a1 leave three coefficients and five operations.
// Delay: 1/(2 pi Q f0) s at low frequency.
// Cost: 15 instructions on Cortex-M4F (advance).
// Range: 0 < f0 < half the sample rate, Q > 0.
// Numerical bound: as the biquad.
// Bad at: lines that wander further than f0 / Q.
#pragma once

#include <cmath>

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

struct NotchConfig {
  double frequency_hz = 1000;
  double quality = 2;  ///< Q: centre frequency over -3 dB bandwidth
  double sample_period_s = 125e-6;
};

template <RealNumber Real>
class Notch {
 public:
  using Config = NotchConfig;
  struct State {
    Real s1 = 0;
    Real s2 = 0;
    Real output = 0;
    bool held = false;  ///< the newest input was no number; the output before it is repeated
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (!(c.frequency_hz > 0 && c.frequency_hz * c.sample_period_s < 0.5))
      return Status::invalid("frequency_hz", "must be within 0 and half the sample rate");
    if (!(c.quality > 0 && is_finite(c.quality)))
      return Status::invalid("quality", "must be positive");
    return {};
  }
  void configure(const Config& c) noexcept {
    const double angle = kTwoPi * c.frequency_hz * c.sample_period_s;
    const double k = std::tan(angle / 2);
    const double n = 1 + k / c.quality + k * k;
    const double b0 = (1 + k * k) / n;
    b0_ = static_cast<Real>(b0);
    b1_ = static_cast<Real>(-2 * std::cos(angle) * b0);
    a2_ = static_cast<Real>((1 - k / c.quality + k * k) / n);
    reset();
  }
  /// Passes everything, exactly, at the cost of a notch: the limit of an endless quality.
  void configure_open() noexcept {
    b0_ = a2_ = 1;
    b1_ = 0;
    reset();
  }
  void reset() noexcept { state_ = State{}; }
  /// Starts as if `value` had been the input for ever.
  void prime(Real value) noexcept {
    const Real s = value - b0_ * value;
    state_ = State{s, s, value, false};
  }

  Real process(Real x) SERVOSENSE_NONBLOCKING {
    const State before = state_;
    const Real y = advance(x);
    if (!is_finite(y + state_.s1 + state_.s2)) {
      state_ = before;
      state_.held = true;
      return state_.output;
    }
    state_.held = false;
    return y;
  }
  /// process() for a block that has checked its input: `x` must be a number of moderate size.
  Real advance(Real x) SERVOSENSE_NONBLOCKING {
    const Real feed = b0_ * x;
    const Real y = feed + state_.s1;
    state_.s1 = b1_ * (x - y) + state_.s2;
    state_.s2 = feed - a2_ * y;
    return state_.output = y;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  Real b0_ = 1;
  Real b1_ = 0;
  Real a2_ = 1;
};

}  // namespace servosense
