// Fourier lines of the last N samples at multiples of a given angle, renewed with every sample.
//
// Purpose: power at the harmonics of the spindle (or of any phase), N apart from the choice of
// lines. The lines turn with the angle that comes with each sample, so they follow the spindle
// when its speed changes; with the angle 2 pi k n / N they are the DFT bins of Koike 2016.
// Equation: M_h = sum over the window of x e^(-j h angle) (Koike 2016, eq. 2-57...2-60, signs of
// 2-59 repaired); a sinusoid of amplitude A on line h gives |M_h|^2 = (N A / 2)^2, its power is
// 2 |M_h|^2 / N^2. The phase belongs to the angle's zero, not to the newest sample.
// Discretisation: none. cos(h a) and sin(h a) by the Chebyshev recurrence from h = 1. The window
// is kept as a sum that fills and one that drains, so no rounding error lives longer than two
// windows. The ring holds sample, cosine and sine: what leaves is what entered.
// Delay: (N-1)/2 samples for a change of power; settled after N samples.
// Cost: 115 instructions on Cortex-M4F and 36 for each pair of harmonics (294 for ten), 403 for the
// worst sample (the sums change places once in N), independent of N; 12 N bytes in float.
// Range: |x| < 1e15, angle in [-2 pi, 4 pi]; harmonics below half the sample rate.
// Numerical bound: error of a line below 1e-6 N max|x| in float and 1e-13 in double up to the tenth
// harmonic; the same after 24 h as after one window.
// Bad at: a window that is not a whole number of turns (`best_revolution_window` finds one): the
// mean and the neighbouring lines leak in, in proportion to the missing part.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/fast_math.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/moving_variance.hpp"

namespace servosense {

/// True for an angle that `sine_cosine` takes; false for NaN.
template <RealNumber Real>
[[nodiscard]] constexpr bool fits_turn(Real angle_rad) noexcept {
  return angle_rad >= static_cast<Real>(-kTwoPi) && angle_rad <= static_cast<Real>(2 * kTwoPi);
}

/// Cosine and sine of h times an angle, a pair of harmonics at a time: f(h+1) = 2 cos(a) f(h) -
/// f(h-1) (Chebyshev), so that nothing has to be copied. Usage: read `odd`, call next_even(), read
/// `even`, call next_odd(), and so on.
template <RealNumber Real>
struct AngleMultiples {
  explicit AngleMultiples(const SineCosine<Real>& first) noexcept
      : twice(first.cosine + first.cosine), odd(first), even{0, 1} {}
  void next_even() noexcept {
    even.cosine = twice * odd.cosine - even.cosine;
    even.sine = twice * odd.sine - even.sine;
  }
  void next_odd() noexcept {
    odd.cosine = twice * even.cosine - odd.cosine;
    odd.sine = twice * even.sine - odd.sine;
  }
  Real twice;
  SineCosine<Real> odd;
  SineCosine<Real> even;
};

struct MovingFourierConfig {
  std::size_t window_samples = 512;
  std::size_t harmonics = 10;
};

template <RealNumber Real, std::size_t Capacity, std::size_t Harmonics>
class MovingFourier {
 public:
  using Config = MovingFourierConfig;
  struct State {
    struct Line {
      SineCosine<Real> fill{0, 0};
      SineCosine<Real> drain{0, 0};
    };
    std::array<Line, 2 * ((Harmonics + 1) / 2)> lines{};  // harmonics 1, 2, ...
    std::uint32_t filling = 0;                            // samples in the sum that fills
    std::uint32_t draining = 0;                           // samples in the sum that drains
    std::uint64_t held = 0;   ///< samples whose value or angle was invalid
    bool settled = false;     ///< the window is full
    bool input_held = false;  ///< the newest sample was such a stand-in
  };

  static Status validate(const Config& c) noexcept {
    if (c.window_samples < 2 || c.window_samples > Capacity)
      return Status::invalid("window_samples", "must be within 2 and the block's capacity");
    if (c.harmonics < 1 || c.harmonics > Harmonics)
      return Status::invalid("harmonics", "must be within 1 and the block's capacity");
    return {};
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    window_ = c.window_samples;
    pairs_ = (c.harmonics + 1) / 2;
    reset();
  }
  void reset() noexcept {
    state_ = State{};
    at_ = 0;
  }

  /// Adds sample `x` taken at `angle_rad`. An invalid sample or angle repeats the last sample at
  /// the last angle.
  void process(Real x, Real angle_rad) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.input_held = !(fits_window(x) && fits_turn(angle_rad));
    Sample in;
    if (s.input_held) {
      ++s.held;
      if (s.filling + s.draining == 0) return;
      in = memory_[(at_ == 0 ? window_ : at_) - 1];
    } else {
      in = Sample{x, sine_cosine(angle_rad)};
    }
    Sample out{0, {0, 1}};
    if (s.settled) {
      out = memory_[at_];
      if (s.draining == 0) {
        for (std::size_t h = 0; h < 2 * pairs_; ++h) s.lines[h] = {{0, 0}, s.lines[h].fill};
        s.draining = s.filling;
        s.filling = 0;
      }
      --s.draining;
    }
    memory_[at_] = in;
    if (++at_ == window_) at_ = 0;
    // What enters and what leaves in step, which processors with vectors take at once.
    const Real a = in.turn.cosine + in.turn.cosine;
    const Real b = out.turn.cosine + out.turn.cosine;
    const Four twice{a, a, b, b};
    const Four value{in.value, in.value, -out.value, -out.value};
    Four odd{in.turn.sine, in.turn.cosine, out.turn.sine, out.turn.cosine};
    Four even{0, 1, 0, 1};
    for (std::size_t p = 0; p < pairs_; ++p) {
      exchange(s.lines[2 * p], value, odd);
      advance(even, twice, odd);
      exchange(s.lines[2 * p + 1], value, even);
      advance(odd, twice, even);
    }
    ++s.filling;
    s.settled = s.filling + s.draining == window_;
  }

  /// Sum of x cos(h angle) over the window. Requires 1 <= h <= harmonics.
  [[nodiscard]] Real cosine_sum(std::size_t h) const noexcept {
    return state_.lines[h - 1].fill.cosine + state_.lines[h - 1].drain.cosine;
  }
  /// Sum of x sin(h angle) over the window; M_h = cosine_sum - j sine_sum.
  [[nodiscard]] Real sine_sum(std::size_t h) const noexcept {
    return state_.lines[h - 1].fill.sine + state_.lines[h - 1].drain.sine;
  }
  /// 2 |M_h|^2 / n^2: power of a sinusoid on that line, n the samples in the window; 0 when empty.
  [[nodiscard]] Real power(std::size_t h) const noexcept {
    const auto n = static_cast<Real>(state_.filling + state_.draining);
    if (!(n > 0)) return Real(0);
    const Real c = cosine_sum(h);
    const Real s = sine_sum(h);
    return Real(2) * (c * c + s * s) / (n * n);
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  struct Sample {
    Real value;
    SineCosine<Real> turn;
  };

  using Four = std::array<Real, 4>;  // sine and cosine of what enters, of what leaves

  // Chebyshev, as AngleMultiples.
  static void advance(Four& next, const Four& twice, const Four& last) noexcept {
    next = {twice[0] * last[0] - next[0], twice[1] * last[1] - next[1],
            twice[2] * last[2] - next[2], twice[3] * last[3] - next[3]};
  }
  static void exchange(typename State::Line& line, const Four& value, const Four& turn) noexcept {
    line.fill.sine += value[0] * turn[0];
    line.fill.cosine += value[1] * turn[1];
    line.drain.sine += value[2] * turn[2];
    line.drain.cosine += value[3] * turn[3];
  }

  State state_;
  std::array<Sample, Capacity> memory_{};
  std::size_t window_ = 0;
  std::size_t pairs_ = 0;  // of harmonics
  std::size_t at_ = 0;     // next place in the ring
};

/// A window of fixed length and how nearly it holds whole turns.
struct RevolutionWindow {
  std::size_t samples = 0;  ///< 0 when no whole number of turns fits between the limits
  std::size_t revolutions = 0;
  double error_samples = 0;  ///< samples - revolutions * samples per turn
};

/// The window between `min_samples` and `max_samples` that misses whole turns by the smallest part
/// of its length; the shorter one when two are alike. Not for the real-time path. Speed in rad/s,
/// either sign; sample rate in Hz.
[[nodiscard]] constexpr RevolutionWindow best_revolution_window(double speed_rad_s,
                                                                double sample_rate_hz,
                                                                std::size_t min_samples,
                                                                std::size_t max_samples) noexcept {
  RevolutionWindow best;
  const double speed = speed_rad_s < 0 ? -speed_rad_s : speed_rad_s;
  const double samples_per_turn = kTwoPi * sample_rate_hz / speed;
  double best_part = 1;
  if (!(samples_per_turn >= 1 && samples_per_turn <= static_cast<double>(max_samples) + 0.5))
    return best;
  for (std::size_t turns = 1;; ++turns) {
    const double exact = static_cast<double>(turns) * samples_per_turn;
    const auto samples = static_cast<std::size_t>(std::lround(exact));
    if (samples > max_samples) return best;
    const double error = static_cast<double>(samples) - exact;
    const double part = (error < 0 ? -error : error) / exact;
    if (samples >= min_samples && samples >= 2 && part < best_part - 1e-9) {
      best = {samples, turns, error};
      best_part = part;
    }
  }
}

}  // namespace servosense
