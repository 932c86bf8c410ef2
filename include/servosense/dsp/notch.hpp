// Notch: takes one line out and leaves the rest.
//
// Purpose: removes the lines that the sampling structure of a controller puts on the force estimate
// (Koike 2016, ch. 5: 1000 and 2000 Hz at 8 kHz with a 2 kHz current update).
//   H(s) = (s^2 + w0^2) / (s^2 + s w0/Q + w0^2)
// Discretisation: bilinear, prewarped at w0, so that the null lies exactly on the line:
//   k = tan(w0 T / 2), b = (1 + k^2) / n [1, -2 cos(w0 T), 1], a2 = (1 - k/Q + k^2) / n, n = 1 +
//   k/Q + k^2
// Delay: 1/(2 pi Q f0) s at low frequency. Cost: one biquad. Range: 0 < f0 < half the sample rate,
// Q > 0. Numerical bound: as the biquad. Bad at: lines that wander further than f0 / Q.
#pragma once

#include <cmath>

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/biquad.hpp"

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
  using State = typename Biquad<Real>::State;

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
    BiquadConfig b;
    b.b0 = b.b2 = (1 + k * k) / n;
    b.b1 = b.a1 = -2 * std::cos(angle) * b.b0;
    b.a2 = (1 - k / c.quality + k * k) / n;
    section_.configure(b);
  }
  void reset() noexcept { section_.reset(); }
  /// Starts as if `value` had been the input for ever.
  void prime(Real value) noexcept { section_.prime(value); }
  Real process(Real x) SERVOSENSE_NONBLOCKING { return section_.process(x); }
  /// process() for a block that has checked its input: `x` must be a number of moderate size.
  Real advance(Real x) SERVOSENSE_NONBLOCKING { return section_.advance(x); }
  [[nodiscard]] const State& state() const noexcept { return section_.state(); }

 private:
  Biquad<Real> section_;
};

}  // namespace servosense
