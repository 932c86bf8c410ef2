// Recursive autoregressive model in lattice form: how far is this sample from what the last p say?
//
// Purpose: residual of the best linear prediction from the last p samples, for signals in which the
// unforeseen matters more than the size: a broken tooth, an entry (Bertok 1984, ch. 3).
//   e(n) = z(n) - sum over i = 1..p of a_i z(n-i),  a from regularised exponentially weighted least
//   squares over all samples before n
// The same residual as the recursive covariance form (Bertok 1984, eq. 3.18-3.19 and 5.5) with
// V = noise_variance and P(0) = E, when nothing is forgotten; the lattice gives those of all lower
// orders on the way.
// Discretisation: least-squares lattice on a-priori errors with error feedback (Ling, Manolakis and
// Proakis 1986; Haykin 1996, sec. 15.12). Per stage, from order i to i + 1, with the backward error
// b and the conversion factor g of the sample before:
//   f' = f + kf b        F  = l F + V (1-l) + g f^2       kf -= g b f' / B
//   b' = b + kb f        B  = l B + V (1-l) + g b^2       kb -= g f b' / F
//   g' = g (l B_before + V (1-l)) / B
// Why this form: the reflection coefficients are corrected by the error they leave, so rounding
// errors are fed back and die out instead of adding up; the energies F and B are sums of squares
// that never fall below V, so no number of exact zeros and no pure tone leads to a division by
// zero; g is a product of ratios within 0 and 1, where the usual difference turns negative. The
// fast transversal recursion of the study (5.5-5.14) is as cheap and has none of that; covariance
// costs p^2 and loses its definiteness (docs/autoregression.md).
// Delay: none; process_some() spreads one sample over several calls.
// Cost on Cortex-M4F: 48 instructions a stage, two of them divisions (compiled loop).
// Range: |z| < 1e12; order p up to the capacity; V > 0. Should an energy ever leave 1e30 all the
// same, the model starts anew and counts it in `resets`.
// Numerical bound: in float within 1e-5 of the signal's size of the double residual, down to V of
// 1e-8 of its power (measured); with forgetting no error outlives the memory, so 24 h are as a
// minute (tested over three hours of zeros, a tone and steps, 1.7e7 samples).
// Bad at: a model of p coefficients needs about 2p samples before its residual means anything; it
// learns whatever lasts, a broken tooth included.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"

namespace servosense {

struct LatticeArConfig {
  unsigned order = 24;          ///< p: cover one revolution, better two (Bertok 1984, 3.3.2.3)
  double noise_variance = 0.1;  ///< V [square of the signal's unit]
  double forgetting = 1;        ///< l, weight of a sample once one more has come; 1 = never forgets
};

template <RealNumber Real, std::size_t MaxOrder>
class LatticeAr {
  static_assert(MaxOrder >= 1);

 public:
  using Config = LatticeArConfig;
  /// From order i to order i + 1.
  struct Stage {
    Real forward_reflection = 0;
    Real backward_reflection = 0;
    Real forward_energy = 1;
    Real backward_energy = 1;
    Real inverse_backward_energy = 1;
    Real backward_error = 0;  // of order i, at the last sample
    Real conversion = 1;      // of order i, at the last sample
  };
  struct State {
    Real residual = 0;          ///< e(n) of the newest complete sample
    bool held = false;          ///< the newest sample was no number; nothing was learnt from it
    std::uint32_t samples = 0;  ///< learnt from; stops at 2^32 - 1
    std::uint32_t resets = 0;   ///< times the model lost its footing and started anew
    std::uint32_t stage = 0;    ///< the next one of the sample under way; p = none under way
    Real forward = 0;           ///< errors and conversion factor at that stage
    Real backward = 0;
    Real conversion = 1;
    std::array<Stage, MaxOrder> stages{};
  };

  static Status validate(const Config& c) noexcept {
    if (c.order < 1 || c.order > MaxOrder)
      return Status::invalid("order", "must be within 1 and the block's capacity");
    if (!(c.noise_variance > 1e-20 && c.noise_variance < 1e20))
      return Status::invalid("noise_variance", "must be positive, within 1e-20 and 1e20");
    if (!(c.forgetting > 0 && c.forgetting <= 1))
      return Status::invalid("forgetting", "must be above 0 and at most 1");
    return {};
  }
  void configure(const Config& c) noexcept {
    order_ = c.order;
    variance_ = static_cast<Real>(c.noise_variance);
    forgetting_ = static_cast<Real>(c.forgetting);
    leak_ = static_cast<Real>((1 - c.forgetting) * c.noise_variance);
    reset();
  }
  void reset() noexcept {
    State& s = state_;
    s.held = false;
    s.residual = s.forward = s.backward = 0;
    s.conversion = 1;
    s.resets = 0;
    forget();
  }

  /// Residual of this sample. One that is no number leaves the model as it is.
  Real process(Real z) SERVOSENSE_NONBLOCKING {
    begin(z);
    process_some(order_);
    return state_.residual;
  }
  /// Takes a sample; its residual is there once process_some() has returned true. Finishes the one
  /// before if need be.
  void begin(Real z) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    process_some(order_);
    s.held = !is_usable(z);
    if (s.held) return;
    s.forward = s.backward = z;
    s.conversion = 1;
    s.stage = 0;
    s.samples += s.samples != 0xffffffffU;
  }
  /// Goes on by at most so many stages. True when this call has completed the sample.
  bool process_some(std::uint32_t stages) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    if (s.stage == order_) return false;
    const std::uint32_t end = order_ - s.stage < stages ? order_ : s.stage + stages;
    for (; s.stage < end; ++s.stage) {
      if (advance(s.stages[s.stage])) continue;
      ++s.resets;
      s.residual = 0;
      forget();
      return true;
    }
    if (s.stage < order_) return false;
    s.residual = s.forward;
    return true;
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  [[nodiscard]] unsigned order() const noexcept { return order_; }

 private:
  static bool is_usable(Real z) noexcept { return z < Real(1e12) && z > Real(-1e12); }

  void forget() noexcept {
    Stage fresh;
    fresh.forward_energy = fresh.backward_energy = variance_;
    fresh.inverse_backward_energy = Real(1) / variance_;
    for (std::uint32_t i = 0; i < order_; ++i) state_.stages[i] = fresh;
    state_.samples = 0;
    state_.stage = order_;
  }

  bool advance(Stage& t) noexcept {
    State& s = state_;
    const Real f = s.forward;
    const Real b = t.backward_error;
    const Real g = t.conversion;
    const Real f_next = f + t.forward_reflection * b;
    const Real b_next = b + t.backward_reflection * f;
    const Real gf = g * f;
    t.forward_energy = forgetting_ * t.forward_energy + leak_ + gf * f;
    t.forward_reflection -= g * b * f_next * t.inverse_backward_energy;
    t.backward_reflection -= gf * b_next / t.forward_energy;
    const Real before = forgetting_ * t.backward_energy + leak_;
    t.backward_energy = before + s.conversion * s.backward * s.backward;
    t.inverse_backward_energy = Real(1) / t.backward_energy;
    t.backward_error = s.backward;
    t.conversion = s.conversion;
    s.forward = f_next;
    s.backward = b_next;
    s.conversion *= before * t.inverse_backward_energy;
    return t.forward_energy < Real(1e30) && t.backward_energy < Real(1e30);  // NaN fails
  }

  State state_;
  std::uint32_t order_ = 1;
  Real variance_ = 1;
  Real forgetting_ = 1;
  Real leak_ = 0;
};

}  // namespace servosense
