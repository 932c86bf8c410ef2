// Rotational filter: of two signals at right angles, the part that turns with a given angle.
//
// Purpose: from the forces in x and y only the vector that rotates with the spindle in one sense;
// vectors that rotate against it, and all other frequencies, are rejected (Koike 2016, sec. 2.3.4).
// Equation, sum over the last N samples, n the age of a sample, p_n the angle turned since:
//   Sx = sum w_n ( x_n cos p_n + y_n sin p_n) / sum w_n
//   Sy = sum w_n (-x_n sin p_n + y_n cos p_n) / sum w_n
// (Koike 2016, eq. 2-71, divided by the sum of the weights instead of N: unity gain whatever the
// window). Clockwise is eq. 2-61, y leading x by a quarter turn. Of x = A sin a, y = B sin(a + d),
// a the angle, remains a circle of radius sqrt(A^2 + B^2 + 2 A B sin d) / 2. The angle comes with
// each sample, so the filter follows the spindle when its speed changes; where the source fixes a
// frequency, p_n = n w0 / Fs.
// Discretisation: none. Each sample is turned back by its angle; a window made of cosines of period
// N is then a few running sums of the sample times cos and sin(2 pi k i / N), i the place in the
// ring. A sample leaves N later at the same place, so what leaves is what entered to the last bit.
// Once round the ring the sums are replaced by others that began at zero there and have just seen
// the whole window: no rounding error lives longer than two windows.
// Delay: (N-1)/2 samples; settled after N.
// Cost on Cortex-M4F: 173 instructions rectangular, 214 Hann, 259 Blackman, 73 more once in N
// samples, independent of N; 8 N bytes in float.
// Range: |x|, |y| < 1e15, angle in [-2 pi, 4 pi], N from 8 to Capacity, below half a turn a sample.
// Numerical bound: error below N u / 2 of the largest |x|, |y| of two windows, u = 6e-8 in float
// and 1.1e-16 in double (1.5e-5 at N = 500; a steady vector reaches 5e-6, noise 2e-7); the same
// after 24 h as after one window.
// Bad at: resolution. A Hann window has its first null 2 Fs/N beside the angle's frequency: 32 Hz
// at N = 500 and 8 kHz. A spindle slower than 2 to 3 turns a window does not keep the mean out.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>

#include "servosense/core/fast_math.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/moving_fourier.hpp"
#include "servosense/dsp/moving_variance.hpp"

namespace servosense {

/// Windows that are a sum of cosines: w(u) = a0 - a1 cos(2 pi u) + a2 cos(4 pi u), 0 <= u <= 1.
enum class CosineWindow : std::uint8_t {
  rectangular,  ///< first null at Fs/N, largest side lobe 0.217
  hann,         ///< 2 Fs/N, 0.027, falling fast
  blackman,     ///< 3 Fs/N, 0.0012
};

struct CosineTerms {
  std::array<double, 3> a;
  std::size_t cosines;  ///< how many of a1, a2 are used
};
[[nodiscard]] constexpr CosineTerms terms_of(CosineWindow window) noexcept {
  switch (window) {
    case CosineWindow::hann:
      return {{0.5, 0.5, 0}, 1};
    case CosineWindow::blackman:
      return {{0.42, 0.5, 0.08}, 2};
    case CosineWindow::rectangular:
      break;
  }
  return {{1, 0, 0}, 0};
}

/// Weight n of N, taken in the middle of its sample so that the window is symmetric; the weights
/// sum to a0 N. Not for the real-time path.
[[nodiscard]] inline double window_weight(CosineWindow window, std::size_t n,
                                          std::size_t count) noexcept {
  const CosineTerms t = terms_of(window);
  const double u = (static_cast<double>(n) + 0.5) / static_cast<double>(count);
  return t.a[0] - t.a[1] * std::cos(kTwoPi * u) + t.a[2] * std::cos(2 * kTwoPi * u);
}

/// Sense of rotation of the vector that passes while the angle grows, seen from the spindle with x
/// to the right and y upward.
enum class Rotation : std::uint8_t { clockwise, counter_clockwise };

template <RealNumber Real>
struct PlaneVector {
  Real x = 0;
  Real y = 0;
};

/// Length of a vector by Newton's iteration for 1 / sqrt: arithmetic only, relative error below
/// 3e-7 in float and 1e-15 in double; 0 for lengths below 1e-19.
template <RealNumber Real>
[[nodiscard]] constexpr Real length_of(const PlaneVector<Real>& v) noexcept {
  const Real square = v.x * v.x + v.y * v.y;
  const Real half = Real(0.5) * square;
  Real root = 0;  // of 1 / square; the first guess is good to 3.5 %
  if constexpr (std::same_as<Real, float>)
    root = std::bit_cast<float>(0x5f375a86U - (std::bit_cast<std::uint32_t>(square) >> 1U));
  else
    root =
        std::bit_cast<double>(0x5fe6eb50c7b537a9ULL - (std::bit_cast<std::uint64_t>(square) >> 1U));
  const auto better = [half](Real r) { return r * (Real(1.5) - half * r * r); };
  root = better(better(better(root)));
  if constexpr (std::same_as<Real, double>) root = better(root);
  return square * root;
}

struct RotationalFilterConfig {
  std::size_t window_samples = 500;  ///< N
  CosineWindow window = CosineWindow::hann;
  Rotation rotation = Rotation::clockwise;
};

template <RealNumber Real, std::size_t Capacity>
class RotationalFilter {
 public:
  using Config = RotationalFilterConfig;
  using Vector = PlaneVector<Real>;
  static constexpr std::size_t kMostCosines = 2;

  /// Running sums of samples: plain, and times cos and sin(2 pi k i / N).
  struct Sums {
    Vector plain;
    std::array<Vector, kMostCosines> cosine{};
    std::array<Vector, kMostCosines> sine{};
  };
  struct State {
    Vector turning;  ///< what rotates with the angle, in axes that rotate with it
    Vector output;   ///< the same in x and y: Sx, Sy
    Real radius = 0;
    Sums window;                   ///< of the last N samples
    Sums lap;                      ///< of those since the ring's beginning
    SineCosine<Real> turn{0, 1};   ///< of the newest good angle
    SineCosine<Real> place{0, 1};  ///< of 2 pi i / N, i where the next sample goes in the ring
    std::uint64_t held = 0;        ///< samples whose value or angle was invalid
    bool settled = false;          ///< the window is full
    bool input_held = false;       ///< the newest sample was such a stand-in
  };

  static Status validate(const Config& c) noexcept {
    if (c.window_samples < 8 || c.window_samples > Capacity)
      return Status::invalid("window_samples", "must be within 8 and the block's capacity");
    return {};
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    window_ = c.window_samples;
    const CosineTerms terms = terms_of(c.window);
    cosines_ = terms.cosines;
    const double n = static_cast<double>(c.window_samples);
    const double step = kTwoPi / n;
    const double gain = terms.a[0] * n;  // sum of the weights
    plain_weight_ = static_cast<Real>(terms.a[0] / gain);
    weight_ = {static_cast<Real>(-terms.a[1] / gain), static_cast<Real>(terms.a[2] / gain)};
    half_step_ = {static_cast<Real>(std::sin(step / 2)), static_cast<Real>(std::cos(step / 2))};
    step_sine_ = static_cast<Real>(std::sin(step));
    step_versine_ = static_cast<Real>(2 * std::sin(step / 2) * std::sin(step / 2));
    mirror_ = c.rotation == Rotation::clockwise ? Real(1) : Real(-1);
    reset();
  }
  /// Takes no longer than a sample: the ring need not be cleared.
  void reset() noexcept {
    state_ = State{};
    at_ = 0;
  }

  /// Adds the vector (x, y) taken at `angle_rad`; the radius of what rotates. While the window
  /// fills, what has not come counts as zero. For an invalid sample the part that rotates goes on.
  Real process(Real x, Real y, Real angle_rad) SERVOSENSE_NONBLOCKING {
    add(x, y, angle_rad);
    return evaluate();
  }
  /// process() in two halves, for those who do not need the result of every sample: takes one...
  void add(Real x, Real y, Real angle_rad) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.input_held = !(fits_window(x) && fits_window(y) && fits_turn(angle_rad));
    if (!s.input_held) return advance(x, y, sine_cosine(angle_rad));
    ++s.held;
    enter(s.turning);
  }
  /// ...or one that has been checked, with sine and cosine of its angle...
  void advance(Real x, Real y, const SineCosine<Real>& turn) SERVOSENSE_NONBLOCKING {
    state_.turn = turn;
    y *= mirror_;
    enter({x * turn.cosine - y * turn.sine, y * turn.cosine + x * turn.sine});
  }
  /// ...and gives the radius of what rotates; `turning` and `output` with it.
  Real evaluate() SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.turning = sum_up();
    s.radius = length_of(s.turning);
    const Vector& t = s.turning;
    s.output = {t.x * s.turn.cosine + t.y * s.turn.sine,
                mirror_ * (t.y * s.turn.cosine - t.x * s.turn.sine)};
    return s.radius;
  }

  /// Place in the ring where the next sample goes; from 0 on nothing is left of what came more than
  /// a window before.
  [[nodiscard]] std::size_t place() const noexcept { return at_; }
  [[nodiscard]] std::size_t window_samples() const noexcept { return window_; }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  static void add(Vector& sum, Real factor, const Vector& v) noexcept {
    sum.x += factor * v.x;
    sum.y += factor * v.y;
  }

  // A vector in axes that rotate.
  void enter(const Vector& in) noexcept {
    State& s = state_;
    const Vector out = s.settled ? ring_[at_] : Vector{};
    ring_[at_] = in;
    exchange(in, out);

    // Turned on by 1 - cos and sin of the step: small numbers, so the rounding is theirs alone.
    const SineCosine<Real> p = s.place;
    s.place.cosine -= step_versine_ * p.cosine + step_sine_ * p.sine;
    s.place.sine -= step_versine_ * p.sine - step_sine_ * p.cosine;
    if (++at_ == window_) begin_lap();
  }

  void exchange(const Vector& in, const Vector& out) noexcept {
    State& s = state_;
    const Vector change{in.x - out.x, in.y - out.y};
    add(s.window.plain, 1, change);
    add(s.lap.plain, 1, in);
    if (cosines_ > 0) exchange_term(0, s.place, in, change);
    if (cosines_ > 1) exchange_term(1, doubled(s.place), in, change);
  }
  void exchange_term(std::size_t k, const SineCosine<Real>& p, const Vector& in,
                     const Vector& change) noexcept {
    State& s = state_;
    add(s.window.cosine[k], p.cosine, change);
    add(s.window.sine[k], p.sine, change);
    add(s.lap.cosine[k], p.cosine, in);
    add(s.lap.sine[k], p.sine, in);
  }

  // The place begins anew, too, so that its rounding does not add up.
  void begin_lap() noexcept {
    State& s = state_;
    at_ = 0;
    s.window = s.lap;
    s.lap = Sums{};
    s.place = {0, 1};
    s.settled = true;
  }

  // sum of in_i cos(2 pi k (now - i + 1/2) / N) by the addition theorem; `place` is one beyond now.
  [[nodiscard]] Vector sum_up() const noexcept {
    const State& s = state_;
    Vector total{plain_weight_ * s.window.plain.x, plain_weight_ * s.window.plain.y};
    if (cosines_ == 0) return total;
    const SineCosine<Real>& p = s.place;
    const SineCosine<Real> now{p.sine * half_step_.cosine - p.cosine * half_step_.sine,
                               p.cosine * half_step_.cosine + p.sine * half_step_.sine};
    add_term(total, 0, now);
    if (cosines_ > 1) add_term(total, 1, doubled(now));
    return total;
  }
  void add_term(Vector& total, std::size_t k, const SineCosine<Real>& now) const noexcept {
    add(total, weight_[k] * now.cosine, state_.window.cosine[k]);
    add(total, weight_[k] * now.sine, state_.window.sine[k]);
  }

  static SineCosine<Real> doubled(const SineCosine<Real>& p) noexcept {
    const Real twice = p.cosine + p.cosine;
    return {twice * p.sine, twice * p.cosine - Real(1)};
  }

  State state_;
  std::array<Vector, Capacity> ring_{};  // turned back by their angles
  std::size_t window_ = 0;
  std::size_t at_ = 0;
  std::size_t cosines_ = 0;
  Real plain_weight_ = 0;
  std::array<Real, kMostCosines> weight_{};
  SineCosine<Real> half_step_{0, 1};
  Real step_sine_ = 0;
  Real step_versine_ = 0;
  Real mirror_ = 1;
};

/// The filter as it is defined, over all of the given samples, oldest first: N multiplications a
/// sample and coefficient. For records, other windows and comparison; not for the real-time path.
/// Requires x, y and angle of one length. The result belongs to the newest sample.
template <RealNumber Real>
[[nodiscard]] PlaneVector<double> rotational_filter_direct(std::span<const Real> x,
                                                           std::span<const Real> y,
                                                           std::span<const Real> angle_rad,
                                                           CosineWindow window,
                                                           Rotation rotation) noexcept {
  PlaneVector<double> sum;
  double weights = 0;
  const double mirror = rotation == Rotation::clockwise ? 1 : -1;
  const std::size_t count = x.size();
  for (std::size_t n = 0; n < count; ++n) {
    const std::size_t i = count - 1 - n;
    const double turned =
        static_cast<double>(angle_rad[count - 1]) - static_cast<double>(angle_rad[i]);
    const double w = window_weight(window, n, count);
    const double c = w * std::cos(turned);
    const double q = w * std::sin(turned);
    const auto xn = static_cast<double>(x[i]);
    const double yn = mirror * static_cast<double>(y[i]);
    sum.x += xn * c + yn * q;
    sum.y += yn * c - xn * q;
    weights += w;
  }
  return {sum.x / weights, mirror * sum.y / weights};
}

}  // namespace servosense
