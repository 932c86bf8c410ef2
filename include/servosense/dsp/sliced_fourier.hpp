// Power spectrum of a block of real samples, worked out in slices of equal cost.
//
// Purpose: a transform inside a servo period without a burst: what a transform costs at once is
// spread over the samples until the next one is due.
// Equation: P_k = |sum over n of w_n x_n e^(-2 pi j k n / N)|^2, k = 0..N/2, with the periodic Hann
// window w_n = (1 - cos(2 pi n / N)) / 2. A sinusoid of amplitude A on a line gives P = (A N / 4)^2
// there, white noise of variance v gives 3/8 N v.
// Discretisation: N real samples are transformed as N/2 complex ones, decimation in time, radix two
// (Cooley and Tukey 1965); the two halves are told apart afterwards (Cooley, Lewis and Welch 1970).
// Sines come from a table of a quarter turn.
// Delay: kSlices calls of step() after begin().
// Cost on Cortex-M4F: within that of the chatter lines (monitors/chatter_lines.hpp).
// Range: |x| < 1e15 in float.
// Numerical bound: 1.2e-6 of the largest line in float; nothing outlives a block.
// Bad at: N that is no power of two.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "servosense/core/fast_math.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/units.hpp"

namespace servosense {

/// cos(2 pi i / Points) for every i, from a table of a quarter turn.
template <RealNumber Real, std::uint32_t Points>
struct CosineTable {
  static constexpr std::uint32_t kQuarter = Points / 4;
  static constexpr std::array<Real, kQuarter + 1> kTable = [] {
    std::array<Real, kQuarter + 1> table{};
    for (std::uint32_t i = 0; i <= kQuarter; ++i)
      table[i] = static_cast<Real>(sine_cosine(kTwoPi * i / Points).cosine);
    return table;
  }();
  [[nodiscard]] static constexpr Real cosine(std::uint32_t i) noexcept {
    i &= Points - 1;
    if (i > Points / 2) i = Points - i;
    return i <= kQuarter ? kTable[i] : -kTable[Points / 2 - i];
  }
  [[nodiscard]] static constexpr Real sine(std::uint32_t i) noexcept {
    return cosine(i + Points - kQuarter);
  }
};

template <RealNumber Real, std::uint32_t Points>
class SlicedFourier {
  static_assert(std::has_single_bit(Points) && Points >= 64);

 public:
  using Table = CosineTable<Real, Points>;
  static constexpr std::uint32_t kHalf = Points / 2;
  /// What one step() does: samples, butterflies, pairs of lines.
  static constexpr std::uint32_t kLoads = 16, kButterflies = 12, kPairs = 4;
  static constexpr std::uint32_t kStages = std::bit_width(kHalf) - 1;
  static constexpr std::uint32_t kTotal = kStages * kHalf / 2;
  /// Calls of step() that a transform takes.
  static constexpr std::uint32_t kSlices =
      Points / kLoads + (kTotal + kButterflies - 1) / kButterflies + (kHalf / 2 + kPairs) / kPairs;

  struct State {
    std::array<Real, kHalf> re{}, im{};
    std::array<Real, kHalf + 1> power{};
    std::uint32_t next = 0;  ///< of the present stage
    enum class Stage : unsigned char { idle, load, turn, part } stage = Stage::idle;
  };

  void reset() noexcept { state_ = State{}; }
  /// Begins a block; one that is under way is dropped.
  void begin() noexcept {
    state_.next = 0;
    state_.stage = State::Stage::load;
  }
  [[nodiscard]] bool idle() const noexcept { return state_.stage == State::Stage::idle; }
  /// A slice. `sample(n)` is the n-th sample of the block, n = 0..Points - 1, asked for in turn
  /// within the first Points / kLoads slices. True with the last slice.
  template <typename Sample>
  bool step(Sample&& sample) noexcept {
    using Stage = typename State::Stage;
    State& s = state_;
    switch (s.stage) {
      case Stage::idle:
        return false;
      case Stage::load:
        for (std::uint32_t i = 0; i < kLoads; i += 2, s.next += 2) {
          const std::uint32_t to = reversed(s.next / 2);
          s.re[to] = window(s.next) * sample(s.next);
          s.im[to] = window(s.next + 1) * sample(s.next + 1);
        }
        if (s.next == Points) advance(Stage::turn);
        return false;
      case Stage::turn:
        for (std::uint32_t i = 0; i < kButterflies && s.next < kTotal; ++i) butterfly(s.next++);
        if (s.next == kTotal) advance(Stage::part);
        return false;
      case Stage::part:
        for (std::uint32_t i = 0; i < kPairs && s.next <= kHalf / 2; ++i) part(s.next++);
        if (s.next <= kHalf / 2) return false;
        advance(Stage::idle);
        return true;
    }
    return false;
  }
  /// P_k of the last complete block, k = 0..Points / 2.
  [[nodiscard]] Real power(std::uint32_t k) const noexcept { return state_.power[k]; }
  [[nodiscard]] const State& state() const noexcept { return state_; }
  [[nodiscard]] static constexpr Real window(std::uint32_t n) noexcept {
    return Real(0.5) - Real(0.5) * Table::cosine(n);
  }

 private:
  void advance(typename State::Stage stage) noexcept {
    state_.next = 0;
    state_.stage = stage;
  }
  [[nodiscard]] static constexpr std::uint32_t reversed(std::uint32_t i) noexcept {
    std::uint32_t r = 0;
    for (std::uint32_t bit = 0; bit < kStages; ++bit, i >>= 1U) r = (r << 1U) | (i & 1U);
    return r;
  }
  void butterfly(std::uint32_t n) noexcept {
    State& s = state_;
    const std::uint32_t stage = n / (kHalf / 2);
    const std::uint32_t in_stage = n & (kHalf / 2 - 1);
    const std::uint32_t span = 1U << stage;
    const std::uint32_t k = in_stage & (span - 1);
    const std::uint32_t a = ((in_stage >> stage) << (stage + 1)) + k;
    const std::uint32_t b = a + span;
    const std::uint32_t turn = k * (kHalf >> stage);  // of Points: 2 pi k / (2 span)
    const Real c = Table::cosine(turn), d = Table::sine(turn);
    const Real re = c * s.re[b] + d * s.im[b];
    const Real im = c * s.im[b] - d * s.re[b];
    s.re[b] = s.re[a] - re;
    s.im[b] = s.im[a] - im;
    s.re[a] += re;
    s.im[a] += im;
  }
  // Lines k and N/2 - k.
  void part(std::uint32_t k) noexcept {
    State& s = state_;
    const std::uint32_t other = (kHalf - k) & (kHalf - 1);
    const Real even_re = Real(0.5) * (s.re[k] + s.re[other]);
    const Real even_im = Real(0.5) * (s.im[k] - s.im[other]);
    const Real odd_re = Real(0.5) * (s.im[k] + s.im[other]);
    const Real odd_im = Real(0.5) * (s.re[other] - s.re[k]);
    const Real c = Table::cosine(k), d = Table::sine(k);
    const Real re = c * odd_re + d * odd_im;
    const Real im = c * odd_im - d * odd_re;
    const auto square = [](Real x, Real y) { return x * x + y * y; };
    s.power[k] = square(even_re + re, even_im + im);
    s.power[kHalf - k] = square(even_re - re, even_im - im);
  }

  State state_;
};

}  // namespace servosense
