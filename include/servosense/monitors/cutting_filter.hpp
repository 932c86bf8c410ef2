// The state that the means of a cut are read into: four coefficients and three frictions.
//
// Purpose: a Kalman filter whose work is spread over samples, two rows of its matrix each.
//   states   (K - K0) / s0 of K_tc, K_te, K_rc, K_re: K0 told, s0 the standard error of that
//            friction of spindle, x and y beyond what is known of it, each over its standard error
//   y        = sum g K + friction: linear in the coefficients (model/average_cutting.hpp)
//   predict  P_ii += q_i while that stays within 1: a random walk that ends where nothing is known
//   correct  S = h'P h + r, x += P h nu / S, P -= P h h'P / S   (Kalman 1960)
//   r        mean of nu^2 - h'P h over the last 200 of a kind, within a floor; nu^2 counts 9 S at
//            most
// Before the first observation x = 0 and P = 1: that is the prior.
// Discretisation: observations.
// Delay: kSteps samples an observation.
// Range: h, y and r finite, r > 0.
// Numerical bound: P only falls by what an observation tells and rises to 1; its diagonal is held
// above 1e-6, where float ends.
// Bad at: errors that observations share and that are no state (depth, radius).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"

namespace servosense {

/// In the order of the states.
inline constexpr std::size_t kCuttingCoefficients = 4;
inline constexpr std::size_t kCuttingStates = 7;

template <RealNumber Real>
class CuttingFilter {
 public:
  using Vector = std::array<Real, kCuttingStates>;
  /// Variance of the observations of a kind.
  struct Noise {
    Real variance = 1;
    Real count = 4;
  };
  /// Samples that an observation takes.
  static constexpr std::uint32_t kHalf = (kCuttingStates + 1) / 2;
  static constexpr std::uint32_t kSteps = 2 * kHalf + 1;

  /// The prior.
  void reset() noexcept {
    x_ = {};
    p_ = {};
    for (std::size_t i = 0; i < kCuttingStates; ++i) p_[i][i] = 1;
    step_ = 0;
  }
  /// Time goes by: variances that are added.
  void predict(const Vector& added) noexcept {
    for (std::size_t i = 0; i < kCuttingStates; ++i)
      if (p_[i][i] + added[i] <= 1) p_[i][i] += added[i];
  }
  /// Nothing is known of states `from` to `to` any more, the last one not of them; what was found
  /// is the best guess.
  void doubt(std::size_t from, std::size_t to) noexcept {
    for (std::size_t i = from; i < to; ++i) p_[i][i] = 1;
  }
  /// States `from` to `to`, the last one not of them, are as at the start.
  void forget(std::size_t from, std::size_t to) noexcept {
    for (std::size_t i = from; i < to; ++i) {
      x_[i] = 0;
      for (std::size_t j = 0; j < kCuttingStates; ++j) p_[i][j] = p_[j][i] = 0;
      p_[i][i] = 1;
    }
    step_ = 0;
  }
  /// Begins an observation: what y differs by from that of the prior, h, and the least of r.
  void observe(Real value, const Vector& h, Real floor) noexcept {
    h_ = h;
    innovation_ = value;
    floor_ = floor;
    spread_ = 0;
    step_ = 1;
  }
  [[nodiscard]] bool busy() const noexcept { return step_ != 0; }
  /// Goes on with it. True once innovation() and spread() are known.
  bool advance(Noise& noise) noexcept {
    const std::uint32_t step = step_ - 1;
    step_ = step_ < kSteps ? step_ + 1 : 0;
    if (step == kHalf) {
      weigh(noise);
      return true;
    }
    // A row and its counterpart: those of the corrected half get shorter.
    const std::uint32_t row = step < kHalf ? step : step - kHalf - 1;
    const std::uint32_t other = kCuttingStates - 1 - row;
    if (step < kHalf) {
      project(row);
      if (other != row) project(other);
    } else {
      correct(row);
      if (other != row) correct(other);
    }
    return false;
  }
  /// Of the last observation: what the state did not expect, and the variance of that.
  [[nodiscard]] Real innovation() const noexcept { return innovation_; }
  [[nodiscard]] Real spread() const noexcept { return spread_; }

  [[nodiscard]] Real value(std::size_t i) const noexcept { return x_[i]; }
  [[nodiscard]] Real variance(std::size_t i) const noexcept { return p_[i][i]; }
  [[nodiscard]] Real covariance(std::size_t i, std::size_t j) const noexcept { return p_[i][j]; }

 private:
  static constexpr Real kMemory = 200, kOdd = 9, kLeast = Real(1e-6);

  void project(std::size_t i) noexcept {
    Real sum = 0;
    for (std::size_t j = 0; j < kCuttingStates; ++j) sum += p_[i][j] * h_[j];
    projected_[i] = sum;
    innovation_ -= h_[i] * x_[i];
    spread_ += h_[i] * sum;
  }
  void weigh(Noise& noise) noexcept {
    const Real known = spread_;
    spread_ += noise.variance;
    Real square = innovation_ * innovation_;
    if (square > kOdd * spread_) square = kOdd * spread_;
    if (noise.count < kMemory) noise.count += 1;
    inverse_ = Real(1) / spread_;
    noise.variance += (square - known - noise.variance) / noise.count;
    if (!(noise.variance > floor_)) noise.variance = floor_;
  }
  void correct(std::size_t i) noexcept {
    const Real gain = projected_[i] * inverse_;
    x_[i] += gain * innovation_;
    for (std::size_t j = i; j < kCuttingStates; ++j) p_[j][i] = p_[i][j] -= gain * projected_[j];
    if (!(p_[i][i] > kLeast)) p_[i][i] = kLeast;
  }

  Vector x_{};
  std::array<Vector, kCuttingStates> p_{};
  Vector h_{}, projected_{};
  Real innovation_ = 0, spread_ = 0, inverse_ = 0, floor_ = 0;
  std::uint32_t step_ = 0;
};

}  // namespace servosense
