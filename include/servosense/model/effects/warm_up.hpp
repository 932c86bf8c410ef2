// How warm a drive has become.
//   share = 1 - exp(-t/tau)
// t the running time since the start, through gaps in the data too (first-order heating).
// Discretisation: the clock ticks once a sample, the exponential moves once in tau/1000, exactly:
// steps of 0.1 %, and no rounding however long tau is.
#pragma once

#include <cmath>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/core/whole.hpp"

namespace servosense {

template <RealNumber Real>
class WarmUp {
 public:
  struct State {
    Real cold = 1;  // exp(-t/tau)
    std::uint32_t samples = 0;
  };

  void configure(double time_constant_s, double sample_period_s) noexcept {
    const std::uint32_t samples = whole(1e-3 * time_constant_s / sample_period_s);
    stride_ = samples < 1 ? 1U : samples;
    decay_ = static_cast<Real>(
        std::exp(-static_cast<double>(stride_) * sample_period_s / time_constant_s));
  }
  void reset() noexcept { state_ = State{}; }
  /// One sample on; the share of the whole way from cold to warm.
  Real advance() SERVOSENSE_NONBLOCKING {
    if (++state_.samples >= stride_) {
      state_.samples = 0;
      state_.cold *= decay_;
    }
    return Real(1) - state_.cold;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  Real decay_ = 1;
  std::uint32_t stride_ = 1;
};

}  // namespace servosense
