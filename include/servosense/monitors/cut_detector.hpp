// Whether the tool may be cutting, from the torque of the spindle.
//
// Purpose: a monitor of an axis expects other forces in the cut than in the air.
//   T_f = a/(s+a) T    cutting torque of an observer, friction and inertia removed
//   cutting    |T_f| >= torque_Nm, and hold_s from then on
//   possible   the spindle turns: a first contact that T_f does not show yet looks like this
//   air        the spindle stands
// Where nothing tells cutting from air it cuts: while the spindle turns, when torque_Nm is not
// known; always, when its signals are missing.
// load: T low-passed as the collision monitors hear forces (335 rad/s), its peak held and let go in
// 5 ms, because currents of slow controllers come later than the motion of the axes.
// The level is what the idling run reaches at steady speed, half as much again
// (learn_cutting_torque).
// Discretisation: Euler, a T << 1.
// Delay: a tooth that takes hold is seen when its torque, spread over 1/a = 40 ms, passes the
// level: before the force of the axis shows it or up to some 25 ms after (docs/collision.md).
// Faults: a sample that cannot be trusted is passed over, and what was known stands. In a gap, and
// until the torque is there again and has had hold_s to tell, it is as if the signals were missing.
// Cost: four one-pole filters.
// Range: 0 < a T < 0.1.
// Numerical bound: contractions; nothing drifts.
// Bad at: cuts too light for the spindle; friction that changes by more than the level since the
// identification.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/whole.hpp"

namespace servosense {

enum class CutPresence : std::uint8_t { air, possible, cutting };

struct CutDetectorConfig {
  double sample_period_s = 125e-6;
  double torque_Nm = 0;  ///< that means cutting, after the filter; 0 = not known
  bool unseen = false;   ///< there is a spindle whose signals are missing
  double cutoff_rad_s = 25;
  double minimum_speed_rad_s = 10;  ///< slower than this the spindle does not cut
  double hold_s = 0.03;
  double load_cutoff_rad_s = 335;  ///< that of the forces that the load is held against
  double load_hold_s = 5e-3;
};

template <RealNumber Real>
class CutDetector {
 public:
  using Config = CutDetectorConfig;
  struct State {
    Real torque_Nm = 0;      ///< filtered
    Real increment_rad = 0;  ///< filtered
    Real fast_Nm = 0;        ///< filtered for the load
    Real load_Nm = 0;        ///< torque that may explain a force; no end of it where none is seen
    std::uint32_t left = 0;  ///< samples for which the cut is still held
    CutPresence cut = CutPresence::air;
    bool unseen = false;   ///< there is no torque that can be trusted
    bool assumed = false;  ///< no torque has told of this cut
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (!(c.torque_Nm >= 0 && is_finite(c.torque_Nm)))
      return Status::invalid("torque_Nm", "must be zero (not known) or positive");
    if (!(c.cutoff_rad_s > 0 && c.cutoff_rad_s * c.sample_period_s < 0.1))
      return Status::invalid("cutoff_rad_s", "must be positive, below a tenth of the sample rate");
    if (!(c.minimum_speed_rad_s > 0 && is_finite(c.minimum_speed_rad_s)))
      return Status::invalid("minimum_speed_rad_s", "must be positive");
    if (!(c.load_cutoff_rad_s > 0 && is_finite(c.load_cutoff_rad_s)))
      return Status::invalid("load_cutoff_rad_s", "must be positive");
    if (!(c.load_hold_s > 0 && is_finite(c.load_hold_s)))
      return Status::invalid("load_hold_s", "must be positive");
    if (!(c.hold_s >= 0 && c.hold_s < 1e6 * c.sample_period_s))
      return Status::invalid("hold_s", "must be at least 0, below a million samples");
    return {};
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    const bool known = c.torque_Nm > 0;
    level_ = known ? static_cast<Real>(c.torque_Nm) : std::numeric_limits<Real>::infinity();
    turning_ = known ? CutPresence::possible : CutPresence::cutting;
    at_rest_ = c.unseen ? CutPresence::cutting : CutPresence::air;
    gain_ = static_cast<Real>(c.cutoff_rad_s * c.sample_period_s);
    const double load = c.load_cutoff_rad_s * c.sample_period_s;
    load_gain_ = static_cast<Real>(load / (1 + load));  // implicit: stable at any rate
    keep_ = static_cast<Real>(1 / (1 + c.sample_period_s / c.load_hold_s));
    slow_ = static_cast<Real>(c.minimum_speed_rad_s * c.sample_period_s);
    hold_ = nearest_whole(c.hold_s / c.sample_period_s);
    reset();
  }
  void reset() noexcept {
    state_ = State{};
    state_.cut = at_rest_;
    if (at_rest_ == CutPresence::cutting) state_.load_Nm = std::numeric_limits<Real>::max();
  }

  /// One servo period: cutting torque and increment of the spindle, and what is known against them.
  CutPresence process(Real torque_Nm, Real increment_rad, Quality quality) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    if (quality > Quality::held ||
        !is_finite(torque_Nm * torque_Nm + increment_rad * increment_rad))
      return take_fault(quality);
    if (s.unseen) see(torque_Nm);
    s.torque_Nm += gain_ * (torque_Nm - s.torque_Nm);
    s.increment_rad += gain_ * (increment_rad - s.increment_rad);
    s.fast_Nm += load_gain_ * (torque_Nm - s.fast_Nm);
    const Real kept = keep_ * s.load_Nm, now = std::abs(s.fast_Nm);
    s.load_Nm = now > kept ? now : kept;
    if (std::abs(s.torque_Nm) >= level_) {
      s.left = hold_;
      s.assumed = false;
      return s.cut = CutPresence::cutting;
    }
    if (s.left > 0) {
      --s.left;
      return s.cut;
    }
    s.assumed = false;
    return s.cut = by_speed();
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  [[gnu::noinline]] CutPresence take_fault(Quality quality) noexcept {
    State& s = state_;
    if (has(quality, Quality::gap | Quality::restarted | Quality::settling)) {
      const Real increment = s.increment_rad;
      s = State{};
      s.increment_rad = increment;
      s.unseen = s.assumed = true;
      s.cut = CutPresence::cutting;
      s.load_Nm = std::numeric_limits<Real>::max();
    }
    return s.cut;
  }
  // Again; it takes a while until what is low-passed tells.
  [[gnu::noinline]] void see(Real torque_Nm) noexcept {
    State& s = state_;
    s.unseen = false;
    s.torque_Nm = s.fast_Nm = torque_Nm;
    s.load_Nm = std::abs(torque_Nm);
    s.left = hold_;
  }
  [[nodiscard]] CutPresence by_speed() const noexcept {
    return std::abs(state_.increment_rad) >= slow_ ? turning_ : CutPresence::air;
  }

  State state_;
  Real level_ = 0;
  Real gain_ = 0;
  Real load_gain_ = 0;
  Real keep_ = 0;
  Real slow_ = 0;
  std::uint32_t hold_ = 0;
  CutPresence turning_ = CutPresence::possible;
  CutPresence at_rest_ = CutPresence::air;
};

}  // namespace servosense
