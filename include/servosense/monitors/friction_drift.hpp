// What friction has changed by since the machine was identified, learned in the air.
//
// Purpose: friction changes with heat (55 N in Koike 2016, ch. 4); a monitor that compares forces
// of today with those of the first hole has to know by how much.
// Equation: e(v) = o + c sgn(v) + d v / reference speed, a Kalman filter (1960) on a random walk of
// o, c and d; values of moves faster than the usual speed count less, with the square of the speed.
// Discretisation: one step a value; time passes in elapse().
// Delay: none.
// Cost on Cortex-M4F: within that of the wear monitor.
// Range: values and speeds finite.
// Numerical bound: variances stay between zero and those at the start; nothing drifts in 24 h.
// Bad at: friction that changes with position; one direction alone cannot tell o from c.
#pragma once

#include <array>
#include <cstddef>

#include "servosense/core/real_time.hpp"

namespace servosense {

struct FrictionDriftConfig {
  double offset_error = 0;     ///< standard deviation at the start, as `friction_error`
  double friction_error = 0;   ///< of c, and of d at the reference speed
  double drift = 0;            ///< of each in 1 s
  double noise = 0;            ///< of a value at `usual_speed` or slower
  double usual_speed = 1;      ///< where friction has to be known; noise grows beyond it
  double reference_speed = 1;  ///< that d refers to
};

/// What friction has changed by: o + c sgn(v) + d v / reference speed, from values in the air.
template <RealNumber Real>
class FrictionDrift {
 public:
  struct State {
    std::array<Real, 3> x{};  ///< o, c, d
    // Covariance: oo, oc, od, cc, cd, dd.
    std::array<Real, 6> p{};
  };

  void configure(const FrictionDriftConfig& c) noexcept {
    auto square = [](double x) { return static_cast<Real>(x * x); };
    first_ = {square(c.offset_error), square(c.friction_error), square(c.friction_error)};
    // What is known to be zero does not move either.
    for (std::size_t i = 0; i < 3; ++i) drift_[i] = first_[i] > 0 ? square(c.drift) : Real(0);
    noise_ = square(c.noise);
    per_usual_ = static_cast<Real>(1 / c.usual_speed);
    per_reference_ = static_cast<Real>(1 / c.reference_speed);
  }
  void reset(State& s) const noexcept {
    s = State{};
    doubt(s);
  }
  /// An unknown time has passed: what is known is as uncertain as at the start.
  void doubt(State& s) const noexcept {
    s.p = {};
    for (std::size_t i = 0; i < 3; ++i) s.p[kDiagonal[i]] = first_[i];
  }
  [[nodiscard]] Real at(const State& s, Real speed) const noexcept {
    return s.x[0] + sign(speed) * s.x[1] + speed * per_reference_ * s.x[2];
  }
  /// Standard deviation squared of at().
  [[nodiscard]] Real variance(const State& s, Real speed) const noexcept {
    const Row h = row(speed);
    const Row ph = times(s, h);
    return ph[0] * h[0] + ph[1] * h[1] + ph[2] * h[2];
  }
  /// Time passes; what is known gets old, but no older than at the start.
  void elapse(State& s, Real seconds) const noexcept {
    for (std::size_t i = 0; i < 3; ++i) {
      Real& p = s.p[kDiagonal[i]];
      const Real grown = p + drift_[i] * seconds;
      if (grown <= first_[i]) p = grown;
    }
  }
  /// A value in the air. A doubtful one, from what may be a soft cut, is taken only within three
  /// standard deviations of what was expected.
  void learn(State& s, Real value, Real speed, bool doubtful) const noexcept {
    const Row h = row(speed);
    const Row ph = times(s, h);
    const Real apart = speed * per_usual_;
    const Real noise = noise_ * (Real(1) + (apart * apart > 1 ? apart * apart : Real(0)));
    const Real total = ph[0] * h[0] + ph[1] * h[1] + ph[2] * h[2] + noise;
    const Real off = value - at(s, speed);
    if (doubtful && off * off > 9 * total) return;
    const Real scale = Real(1) / total;
    const Real error = off * scale;
    std::size_t k = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      s.x[i] += ph[i] * error;
      for (std::size_t j = i; j < 3; ++j, ++k) s.p[k] -= ph[i] * ph[j] * scale;
      Real& p = s.p[kDiagonal[i]];  // rounding must not make it negative
      if (p < 0) p = 0;
    }
  }

 private:
  using Row = std::array<Real, 3>;
  static constexpr std::array<std::size_t, 3> kDiagonal = {0, 3, 5};
  static Real sign(Real v) noexcept { return v > 0 ? Real(1) : v < 0 ? Real(-1) : Real(0); }
  [[nodiscard]] Row row(Real speed) const noexcept {
    return {Real(1), sign(speed), speed * per_reference_};
  }
  static Row times(const State& s, const Row& h) noexcept {
    const auto& p = s.p;
    return {p[0] * h[0] + p[1] * h[1] + p[2] * h[2], p[1] * h[0] + p[3] * h[1] + p[4] * h[2],
            p[2] * h[0] + p[4] * h[1] + p[5] * h[2]};
  }

  Row first_{};
  Row drift_{};
  Real noise_ = 1;
  Real per_usual_ = 1;
  Real per_reference_ = 1;
};

}  // namespace servosense
