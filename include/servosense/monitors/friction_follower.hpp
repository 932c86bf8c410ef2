// The friction of a spindle as it warms up, followed from stretches in the air.
//
// Purpose: grease and bearings cost less torque warm than cold: 20 to 50 % of the viscous part.
// What was identified warm reads as a cut in the morning. This follows viscous and Coulomb friction
// slowly, so that the monitors hear a corrected estimate (DisturbanceObserver::set_friction).
// A window counts when speed and torque of its halves agree; its mean torque, as it opposes the
// motion, is then
//   below the gate    air: followed, by a Kalman filter on a random walk of both (friction_drift)
//   negative          air all the same: no cut drives a spindle
//   above the gate    a cut, however long: not followed
//   after a start     (the spindle stood before) air up to the bound: what has cooled is caught up
//                     with, until the torque steps
// Friction falls while a spindle runs and grows while it stands. So what is followed upward between
// two starts is at most one gate in all: neither a light cut nor wear that grows slowly can take
// more, and no more than one gate of a cut is ever swallowed.
// Limits, each with its kind:
//   gate           0.25 of cutting_torque_Nm (chosen: idle reaches two thirds of it at most)
//   bound          share of each friction of the machine file (the file says it)
//   rate           a window moves the torque by at most the gate times the filter's gain, about
//                  0.05 (chosen: random walk over the bound in an hour, physical: time constants
//                  of spindles are 10 min to 2 h)
//   start          3 windows after it stood for 2 s (chosen: no tool is in the cut so soon)
// Discretisation: windows of 1 s, means of both halves.
// Delay: some 20 windows in the air.
// Cost: off: none, nothing is called. On: a dozen operations a sample, one filter step a window, by
// whoever feeds it.
// Range: friction and cutting torque above 0; noise of the mean well below the gate.
// Numerical bound: sums of one window; corrections are clamped; nothing drifts.
// Bad at: a spindle that starts in the cut and stays steady there (up to the bound is swallowed
// until it is in the air again); friction that grows while it runs, beyond the gate.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/whole.hpp"
#include "servosense/monitors/friction_drift.hpp"

namespace servosense {

struct FrictionFollowerConfig {
  double sample_period_s = 125e-6;
  double viscous = 0;            ///< of the machine file [Nm s/rad]
  double coulomb = 0;            ///< [Nm]
  double share = 0.5;            ///< of each, by which it may be followed
  double cutting_torque_Nm = 0;  ///< that means cutting
  double minimum_speed_rad_s = 10;
  double window_s = 1;
};

template <RealNumber Real>
class FrictionFollower {
 public:
  using Config = FrictionFollowerConfig;
  struct State {
    Real viscous = 0;  // as followed
    Real coulomb = 0;
    typename FrictionDrift<Real>::State drift;
    // Since the last start, where it was lowest; and the highest speed in all.
    Real lowest_viscous = 0, lowest_coulomb = 0, fastest = 0;
    std::array<Real, 2> torque{};  // sums of the halves of this window
    std::array<Real, 2> travel{};
    Real last = 0;               // torque of the last window after a start
    std::uint32_t samples = 0;   // of this window
    std::uint32_t standing = 0;  // windows
    std::uint32_t starting = 0;  // windows left
    std::uint32_t followed = 0;  // windows
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (!(c.viscous >= 0 && c.coulomb >= 0 && c.viscous + c.coulomb > 0))
      return Status::invalid("viscous, coulomb", "must be known to be followed");
    if (!(c.share > 0 && c.share <= 0.9))
      return Status::invalid("share", "must be within 0 and 0.9");
    if (!(c.cutting_torque_Nm > 0))
      return Status::invalid("cutting_torque_Nm", "must be known, to tell a cut from the air");
    if (!(c.minimum_speed_rad_s > 0))
      return Status::invalid("minimum_speed_rad_s", "must be positive");
    if (!(c.window_s >= 8 * c.sample_period_s))
      return Status::invalid("window_s", "must be eight samples at least");
    return {};
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    viscous_ = static_cast<Real>(c.viscous);
    coulomb_ = static_cast<Real>(c.coulomb);
    share_ = static_cast<Real>(c.share);
    gate_ = static_cast<Real>(kGate * c.cutting_torque_Nm);
    half_ = whole(c.window_s / c.sample_period_s / 2);
    slow_ = static_cast<Real>(c.minimum_speed_rad_s);
    per_s_ = static_cast<Real>(1 / c.sample_period_s);
    window_s_ = static_cast<Real>(c.window_s);
    standing_ = whole(kStands_s / c.window_s + 0.999);
    // Where viscous and Coulomb friction are alike.
    const double alike = c.viscous > 0 ? c.coulomb / c.viscous : 0;
    const double reference = std::clamp(alike, c.minimum_speed_rad_s, 100 * c.minimum_speed_rad_s);
    reference_ = static_cast<Real>(reference);
    FrictionDriftConfig drift;
    drift.friction_error = c.share * std::max(c.coulomb, c.viscous * reference) / 2;
    drift.drift = drift.friction_error / std::sqrt(kWander_s);
    drift.noise = kNoise * c.cutting_torque_Nm;
    drift.usual_speed = 1e6;  // every speed counts alike
    drift.reference_speed = reference;
    drift_.configure(drift);
    reset();
  }
  void reset() noexcept {
    state_ = State{};
    drift_.reset(state_.drift);
    state_.viscous = viscous_;
    state_.coulomb = coulomb_;
    state_.standing = standing_;
    keep_lowest();
  }

  /// One sample: torque that the observer reads with the friction as followed so far, motion [rad].
  /// True when the friction has changed.
  bool process(Real torque_Nm, Real increment_rad, Quality quality) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    if (quality > Quality::held || !is_moderate(torque_Nm) || !is_moderate(increment_rad)) {
      begin_window();
      return false;
    }
    const std::size_t half = s.samples >= half_ ? 1 : 0;
    s.torque[half] += torque_Nm;
    s.travel[half] += increment_rad;
    if (++s.samples < 2 * half_) return false;
    const bool changed = end_window();
    begin_window();
    return changed;
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  /// Torque above which a window is a cut, and the most of one that is ever followed [Nm].
  [[nodiscard]] Real gate_Nm() const noexcept { return gate_; }

 private:
  static constexpr double kGate = 0.25, kNoise = 0.1;  // of cutting_torque_Nm
  static constexpr double kWander_s = 3600, kStands_s = 2;
  static constexpr std::uint32_t kStartWindows = 3;
  static constexpr Real kSteady = Real(0.01);  // of the speed, between the halves

  void begin_window() noexcept {
    State& s = state_;
    s.torque[0] = s.torque[1] = s.travel[0] = s.travel[1] = 0;
    s.samples = 0;
  }
  void keep_lowest() noexcept {
    state_.lowest_viscous = state_.viscous;
    state_.lowest_coulomb = state_.coulomb;
  }
  /// Friction above the lowest, at a speed.
  [[nodiscard]] Real risen(Real speed) const noexcept {
    const State& s = state_;
    return s.coulomb - s.lowest_coulomb + (s.viscous - s.lowest_viscous) * speed;
  }

  [[gnu::noinline]] bool end_window() noexcept {
    State& s = state_;
    const Real n = static_cast<Real>(half_);
    const Real first = s.travel[0] / n * per_s_, second = s.travel[1] / n * per_s_;
    const Real speed = (first + second) / 2;
    const Real sense = speed < 0 ? Real(-1) : Real(1);
    if (std::abs(speed) < slow_) {
      if (s.standing < standing_) ++s.standing;
      drift_.elapse(s.drift, window_s_);
      return false;
    }
    if (std::abs(first - second) > kSteady * std::abs(speed)) return false;
    if (s.standing >= standing_) {
      s.starting = kStartWindows + 1;
      drift_.doubt(s.drift);  // who knows for how long it has cooled
    }
    s.standing = 0;
    const Real torque = sense * (s.torque[0] + s.torque[1]) / (2 * n);  // opposes the motion
    const bool steps = std::abs(s.torque[1] - s.torque[0]) > gate_ * n;
    // The first after a start is what its steps are told from.
    if (s.starting > 0) {
      const bool first_one = s.starting-- == kStartWindows + 1;
      if (steps || (!first_one && std::abs(torque - s.last) > gate_)) s.starting = 0;
      s.last = torque;
      if (s.starting > 0) return follow(torque, speed, true);
    }
    if (steps || torque > gate_) return false;
    return follow(torque > -gate_ ? torque : -gate_, speed, false);
  }

  bool follow(Real torque, Real speed, bool starts) noexcept {
    State& s = state_;
    const Real most = share_ * (coulomb_ + viscous_ * std::abs(speed));
    const Real known = drift_.at(s.drift, speed);
    const Real value = (speed < 0 ? -torque : torque) + known;
    if (std::abs(value) > Real(1.5) * most + gate_) return false;  // no friction of this spindle
    const auto drift_before = s.drift;
    const Real viscous = s.viscous, coulomb = s.coulomb;
    drift_.elapse(s.drift, window_s_);
    drift_.learn(s.drift, value, speed, false);
    Real& c = s.drift.x[1];
    Real& d = s.drift.x[2];
    c = std::clamp(c, -share_ * coulomb_, share_ * coulomb_);
    d = std::clamp(d, -share_ * viscous_ * reference_, share_ * viscous_ * reference_);
    s.coulomb = coulomb_ + c;
    s.viscous = viscous_ + d / reference_;
    s.fastest = std::max(s.fastest, std::abs(speed));
    if (starts || risen(std::abs(speed)) < 0) {
      keep_lowest();
    } else if (risen(s.fastest) > gate_) {
      s.drift.x = drift_before.x;
      s.viscous = viscous;
      s.coulomb = coulomb;
      return false;
    }
    ++s.followed;
    return true;
  }

  State state_;
  FrictionDrift<Real> drift_;
  Real viscous_ = 0;
  Real coulomb_ = 0;
  Real share_ = 0;
  Real gate_ = 0;
  Real slow_ = 0;
  Real per_s_ = 0;
  Real window_s_ = 1;
  Real reference_ = 1;
  std::uint32_t half_ = 1;
  std::uint32_t standing_ = 1;
};

}  // namespace servosense
