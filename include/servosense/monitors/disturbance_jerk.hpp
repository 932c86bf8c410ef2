// Rate of change of a disturbance force, as the collision monitor hears it (Koike 2016, ch. 5):
// [s g/(s+g)] F, notches at the lines of the sampling structure and at the resonance of the stage,
// two-sample average. Discretisation, faults, delay, cost and range: monitors/collision.hpp.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/core/whole.hpp"
#include "servosense/dsp/first_order.hpp"
#include "servosense/dsp/notch.hpp"
#include "servosense/monitors/collision_config.hpp"

namespace servosense {

/// Force to its filtered rate of change [N/s].
template <RealNumber Real>
class DisturbanceJerk {
 public:
  struct State {
    Real last_force = 0;
    std::uint32_t samples = 0;  // since the start, stops at the settling length
    Real last_rate = 0;         // without notches
  };

  void configure(const CollisionConfig& c) noexcept {
    derivative_.configure({c.cutoff_rad_s, c.sample_period_s, Discretisation::tustin});
    for (std::size_t i = 0; i < notch_.size(); ++i) {
      used_[i] = c.notch_hz[i] > 0 && c.notch_hz[i] * c.sample_period_s < 0.45;
      if (used_[i])
        notch_[i].configure({c.notch_hz[i], c.notch_quality, c.sample_period_s});
      else
        notch_[i].configure_open();
    }
    const bool resonant = c.resonance_hz > 0 && c.resonance_hz * c.sample_period_s < 0.45;
    if (resonant) resonance_.configure({c.resonance_hz, c.resonance_quality, c.sample_period_s});
    filters_ = resonant ? Filters::all : used_[0] || used_[1] ? Filters::notches : Filters::none;
    settling_ = whole(10 / (c.cutoff_rad_s * c.sample_period_s) + 1);
    reset();
  }
  void reset() noexcept {
    state_ = State{};
    derivative_.reset();
    for (auto& notch : notch_) notch.reset();
    resonance_.reset();
  }
  /// `force_N` must be a number of moderate size.
  Real process(Real force_N) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    if (s.samples == 0) s.last_force = force_N;
    if (s.samples < settling_) ++s.samples;
    return advance(force_N);
  }
  /// process() once it has settled.
  Real advance(Real force_N) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    Real rate = derivative_.advance(force_N - s.last_force);
    s.last_force = force_N;
    if (filters_ != Filters::notches) return advance_otherwise(rate);
    const Real last = notch_[1].state().output;
    return Real(0.5) * (notch_[1].advance(notch_[0].advance(rate)) + last);
  }
  [[nodiscard]] bool settled() const noexcept { return state_.samples >= settling_; }
  /// False for a notch that is off, or too near half the sample rate.
  [[nodiscard]] bool notch_used(std::size_t i) const noexcept { return used_[i]; }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  enum class Filters : std::uint8_t { notches, none, all };

  Real advance_otherwise(Real rate) noexcept {
    const Real last = filters_ == Filters::none ? state_.last_rate : notch_[1].state().output;
    if (filters_ == Filters::all)
      rate = notch_[1].advance(notch_[0].advance(resonance_.advance(rate)));
    state_.last_rate = rate;
    return Real(0.5) * (rate + last);
  }

  State state_;
  PseudoDerivative<Real> derivative_;
  std::array<Notch<Real>, 2> notch_;
  std::array<bool, 2> used_{};
  Filters filters_ = Filters::none;
  Notch<Real> resonance_;
  std::uint32_t settling_ = 0;
};

}  // namespace servosense
