// The sign of motion, continuous through rest and reversal.
//
// Purpose: Coulomb friction without chatter at zero speed. sgn(v) (Koike 2016, eq. 2-23) flips with
// every count of encoder noise; this sign follows the path instead of the speed:
//   z = clamp(z + dx, -knee, +knee),   S = z / knee
// (an elastic-ideally plastic bristle, the rate-independent limit of Dahl 1968). At rest it keeps
// the friction that is wound up in the contact; after a reversal it swings over within two knees of
// travel.
// Delay: none.
// Cost: 6 instructions on Cortex-M4F.
// Range: knee of at least four encoder counts.
// Numerical bound: z is clamped, so sums do not drift while the drive moves; at rest the error is
// that of adding increments, below 1e-7 of the knee per count.
// Bad at: presliding in detail (that is the effect presliding-hysteresis).
#pragma once

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"

namespace servosense {

template <RealNumber Real>
class ElastoplasticSign {
 public:
  struct State {
    Real deflection = 0;  // z in units of the knee, -1..1
  };

  /// `knee` in m or rad, positive.
  static Status validate(double knee) noexcept {
    return knee > 0 ? Status{} : Status::invalid("knee", "must be positive");
  }
  void configure(double knee) noexcept {
    per_knee_ = static_cast<Real>(1 / knee);
    reset();
  }
  void reset() noexcept { state_ = State{}; }

  Real process(Real increment) SERVOSENSE_NONBLOCKING {
    Real z = state_.deflection + increment * per_knee_;
    z = z > Real(1) ? Real(1) : z;
    z = z < Real(-1) ? Real(-1) : z;
    state_.deflection = z;
    return z;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  Real per_knee_ = 0;
};

}  // namespace servosense
