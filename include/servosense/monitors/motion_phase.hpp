// Phase of an axis's motion: standing, at constant speed, accelerating, reversing.
//
// Purpose: a monitor may expect other noise in each (Koike 2016, ch. 5, names thresholds by phase
// as the cure for false alarms in acceleration).
//   d_k = travel over block k of B seconds
//   standstill    |d_k| and |d_k-1| < standing_m_s B
//   reversal      one of them stands and the other does not, or their signs differ
//   acceleration  |d_k - d_k-1| >= accelerating_m_s2 B^2
//   constant speed otherwise
// A later name in the enum is kept for `hold_s` after its motion has ended: that long the filters
// behind it remember. Not known from the start and after a fault, until hold_s and two blocks
// later.
// Delay: one to two blocks, less than the filters that carry the force.
// Cost: a sum and a count per sample, the rest once a block.
// Range: the block is two samples at least.
// Numerical bound: a sum over one block.
// Bad at: encoders so coarse that one count in a block passes a limit. A contact that stops the
// axis looks like an acceleration: it takes a force of accelerating_m_s2 times the mass.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/whole.hpp"

namespace servosense {

/// In the order of what they do to a force estimate.
enum class MotionPhase : std::uint8_t {
  standstill,
  constant_speed,
  acceleration,
  reversal,
  unknown,
};
inline constexpr std::size_t kMotionPhases = 4;  ///< that are known

struct MotionPhaseConfig {
  double sample_period_s = 125e-6;
  double block_s = 2e-3;
  double hold_s = 0.03;
  double standing_m_s = 2e-3;
  double accelerating_m_s2 = 2;  ///< a fifth of what feed axes do
};

template <RealNumber Real>
class MotionPhaseTracker {
 public:
  using Config = MotionPhaseConfig;
  struct State {
    Real travel = 0;  ///< of this block so far
    std::uint32_t left = 1;
    Real last = 0;            ///< travel of the block before
    std::uint32_t ahead = 0;  ///< blocks that the phase is still held
    MotionPhase phase = MotionPhase::unknown;
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (!(c.block_s > 0 && c.block_s / c.sample_period_s < 1e6))
      return Status::invalid("block_s", "must be positive, and less than a million samples");
    if (!(c.hold_s >= 0 && c.hold_s / c.block_s < 1e6))
      return Status::invalid("hold_s", "must not be negative, nor last a million blocks");
    if (!(c.standing_m_s > 0 && is_finite(c.standing_m_s)))
      return Status::invalid("standing_m_s", "must be positive");
    if (!(c.accelerating_m_s2 > 0 && is_finite(c.accelerating_m_s2)))
      return Status::invalid("accelerating_m_s2", "must be positive");
    return {};
  }
  void configure(const Config& c) noexcept {
    block_ = std::max<std::uint32_t>(2, nearest_whole(c.block_s / c.sample_period_s));
    const double block_s = block_ * c.sample_period_s;
    hold_ = whole(std::ceil(c.hold_s / block_s) + 1);
    standing_ = static_cast<Real>(c.standing_m_s * block_s);
    change_ = static_cast<Real>(c.accelerating_m_s2 * block_s * block_s);
    reset();
  }
  void reset() noexcept {
    state_ = State{};
    state_.left = block_;
    state_.ahead = hold_ + 1;
  }
  /// `increment_m`: travel since the last sample; NaN where nobody knows it.
  void process(Real increment_m) SERVOSENSE_NONBLOCKING {
    state_.travel += increment_m;
    if (--state_.left == 0) take_block();
  }
  [[nodiscard]] MotionPhase phase() const noexcept { return state_.phase; }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  [[gnu::noinline]] void take_block() noexcept {
    State& s = state_;
    const Real travel = s.travel;
    const MotionPhase now = classify(travel, s.last);
    s.last = is_finite(travel) ? travel : Real(0);
    s.travel = 0;
    s.left = block_;
    if (now >= s.phase) {
      s.phase = now;
      s.ahead = hold_;
    } else if (s.ahead > 0) {
      --s.ahead;
    } else {
      s.phase = now;
      s.ahead = hold_;
    }
  }
  [[nodiscard]] MotionPhase classify(Real travel, Real last) const noexcept {
    if (!is_finite(travel)) return MotionPhase::unknown;
    const bool stands = std::abs(travel) < standing_;
    const bool stood = std::abs(last) < standing_;
    if (stands && stood) return MotionPhase::standstill;
    if (stands || stood || (travel < 0) != (last < 0)) return MotionPhase::reversal;
    return std::abs(travel - last) < change_ ? MotionPhase::constant_speed
                                             : MotionPhase::acceleration;
  }

  State state_;
  std::uint32_t block_ = 16;
  std::uint32_t hold_ = 15;
  Real standing_ = 0;
  Real change_ = 0;
};

}  // namespace servosense
