// How far the estimate of a disturbance observer may be from the truth: half the width of a band
// about it.
//
// Purpose: a drive that slides has the friction that the model says, within a few percent. A drive
// that stands has any that holds it: from -C_s to C_s, while the observer subtracts C S, what the
// path says. So the band is
//   h = noise + l |L| + u (C + D |v|) + r J |a| + q C / (1 + (v/v_s)^2) + (1 - slide) p C (1 + |S|)
// and slide = slip / knee within [0, 1], slip the travel beyond the bristle of ElastoplasticSign
// lately, forgotten with 1/e in 5 ms (a knee of 5 um: slower than 1 mm/s rests in part): noise of
// an encoder at rest winds the bristle up and down and does not slip. What has just been at rest is
// remembered as the observer's filters do: the last term is let go with a quarter of the slower
// cutoff, above (1 + g t) exp(-g t) but for 5 %.
//   noise  three times the noise floor, as identified; what no noise floor says is not in it
//   l      of the constant load: what stands on the table changes it
//   u      of friction: it changes by a tenth from day to day (as identify idle takes it)
//   r      of inertia
//   p      1; 1/4, and what a count moves it by, where the presliding hysteresis has been
//   identified, whose bristle then tells
//          what holds the drive
//   q      by which static friction exceeds Coulomb's, C_s = C (1 + q), up to 1.5 C
//   (Armstrong-Helouvry 1994);
//          it is gone beyond some v_s (Stribeck 1902)
// The truth is the force through the observer's own filters: an estimate is late by 1/g + 1/h, and
// the band does not say by how much a force that changes is misread meanwhile.
// Discretisation: implicit Euler.
// Delay: none.
// Cost: beside the observer, on whoever asks: some 30 operations.
// Range: 0 < T times each cutoff < 2, knee above 0.
// Numerical bound: contractions; nothing drifts.
// Bad at: effects that are not known (play, springs, a torque constant that is off); reversals that
// take longer than the knee says.
#pragma once

#include <algorithm>
#include <cmath>

#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

struct EstimateBandConfig {
  double sample_period_s = 125e-6;
  double cutoff_rad_s = 500;     ///< the slower of the observer's
  double noise = 0;              ///< rms of the estimate in the air [N or Nm]; 0: not known
  double inertia = 0;            ///< kg or kg m2
  double viscous = 0;            ///< N s/m or Nm s/rad
  double coulomb = 0;            ///< N or Nm
  double constant_load = 0;      ///< N or Nm
  double friction_knee = 5e-6;   ///< m or rad
  double friction_share = 0.1;   ///< by which sliding friction may differ
  double load_share = 0.01;      ///< by which the load may
  double inertia_share = 0.02;   ///< by which the inertia may
  double stribeck_speed = 0.02;  ///< m/s or rad/s, v_s
  double static_share = 0.5;     ///< of Coulomb friction, by which static friction exceeds it
  double rest_share = 1;         ///< of Coulomb friction, that is not known at rest
  double noise_factor = 3;       ///< 99.7 % of normal noise
  double memory_s = 0.005;       ///< for which a slip counts
};

/// numerical: exp(-3) of a reversal is left after that many times breakaway / stiffness, halved.
inline constexpr double kBristleTravel = 1.5;

/// chosen: of Coulomb friction, what is in doubt at rest where the bristle has been identified.
inline constexpr double kBristleDoubt = 0.25;

/// Of the drive of an observer; `noise` is that of its estimate in the air [N or Nm],
/// `count` a step of its encoder [m or rad], 0 where it is not known. A drive that
/// `turns` has the Stribeck speed of a table of 0.1 m radius.
template <typename Drive>
[[nodiscard]] EstimateBandConfig estimate_band_of(const DisturbanceObserverConfigWith<Drive>& c,
                                                  double noise, double count, bool turns) noexcept {
  EstimateBandConfig band;
  band.sample_period_s = c.sample_period_s;
  band.cutoff_rad_s = std::min(c.disturbance_cutoff_rad_s, c.velocity_cutoff_rad_s);
  band.noise = noise;
  band.inertia = c.drive.inertia;
  band.viscous = c.drive.viscous;
  band.coulomb = c.drive.coulomb;
  band.constant_load = c.drive.constant_load;
  band.friction_knee = c.drive.friction_knee;
  if (turns) band.stribeck_speed /= 0.1;
  // A bristle that yields over a longer travel swings over as slowly.
  if (const EffectSetting* bristle = c.drive.effects.find("presliding-hysteresis")) {
    band.friction_knee =
        std::max(band.friction_knee, kBristleTravel * bristle->scalar(1) / bristle->scalar(0));
    // A count at a reversal, where it is twice as stiff. What a count is not known: no better.
    const double step = 2 * count * bristle->scalar(0);
    band.rest_share = count > 0 && step < (1 - kBristleDoubt) * band.coulomb
                          ? kBristleDoubt + step / band.coulomb
                          : 1;
  }
  return band;
}

template <RealNumber Real>
class EstimateBand {
 public:
  using Config = EstimateBandConfig;
  struct State {
    Real half_width = 0;  // N or Nm
    Real slip = 0;        // lately, in knees, at most one
    Real at_rest = 0;     // what rest adds [N or Nm]
    Real velocity = 0;    // low-passed once, and twice
    Real smooth_velocity = 0;
    Real bristle = 0;    // -1..1
    bool known = false;  // a sample has been heard since the start or a gap
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0)) return Status::invalid("sample_period_s", "must be positive");
    if (!(c.cutoff_rad_s > 0 && c.cutoff_rad_s * c.sample_period_s < 2))
      return Status::invalid("cutoff_rad_s", "must be positive, below twice the sample rate");
    if (!(c.friction_knee > 0)) return Status::invalid("friction_knee", "must be positive");
    if (!(c.stribeck_speed > 0)) return Status::invalid("stribeck_speed", "must be positive");
    if (!(c.memory_s > 0)) return Status::invalid("memory_s", "must be positive");
    if (!is_finite(c.constant_load)) return Status::invalid("constant_load", "must be finite");
    for (const double share :
         {c.noise, c.inertia, c.viscous, c.coulomb, c.friction_share, c.load_share, c.inertia_share,
          c.static_share, c.rest_share, c.noise_factor})
      if (!(share >= 0 && is_finite(share)))
        return Status::invalid("noise, inertia, friction and shares", "must not be negative");
    return {};
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    const double gt = c.cutoff_rad_s * c.sample_period_s;
    gain_ = static_cast<Real>(gt / (1 + gt));
    per_period_ = static_cast<Real>(1 / c.sample_period_s);
    acceleration_ = static_cast<Real>(c.cutoff_rad_s * c.inertia_share * c.inertia);
    release_ = static_cast<Real>(1 / (1 + gt / 4));
    forget_ = static_cast<Real>(1 / (1 + c.sample_period_s / c.memory_s));
    noise_ = static_cast<Real>(c.noise_factor * c.noise + c.load_share * std::abs(c.constant_load) +
                               c.friction_share * c.coulomb);
    viscous_ = static_cast<Real>(c.friction_share * c.viscous);
    rest_ = static_cast<Real>(c.rest_share * c.coulomb);
    static_ = static_cast<Real>(c.coulomb * c.static_share);
    per_stribeck_ = static_cast<Real>(1 / c.stribeck_speed);
    per_knee_ = static_cast<Real>(1 / c.friction_knee);
    reset();
  }
  void reset() noexcept { state_ = State{}; }

  /// One sample of the drive, as the observer hears it; half the width of the band [N or Nm].
  /// A gap, or a number that is not finite, keeps the band; after a gap the drive is taken to rest.
  Real process(Real increment, Quality quality) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    if (has(quality, Quality::gap) || !is_moderate(increment)) {
      s.known = false;
      return s.half_width;
    }
    const Real now = increment * per_period_;
    if (!s.known || has(quality, Quality::restarted)) {
      s = State{};
      s.known = true;
      s.velocity = s.smooth_velocity = now;
    }
    s.velocity += gain_ * (now - s.velocity);
    s.smooth_velocity += gain_ * (s.velocity - s.smooth_velocity);
    const Real wound = s.bristle + increment * per_knee_;
    s.bristle = std::clamp(wound, Real(-1), Real(1));
    s.slip = std::min(forget_ * s.slip + std::abs(wound - s.bristle), Real(1));
    const Real rest = (Real(1) - s.slip) * rest_ * (Real(1) + std::abs(s.bristle));
    s.at_rest = std::max(rest, release_ * s.at_rest);
    const Real speed = std::abs(s.velocity), share = speed * per_stribeck_;
    return s.half_width = noise_ + viscous_ * speed +
                          acceleration_ * std::abs(s.velocity - s.smooth_velocity) +
                          static_ / (Real(1) + share * share) + s.at_rest;
  }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  State state_;
  Real gain_ = 0;
  Real per_period_ = 0;
  Real acceleration_ = 0;
  Real release_ = 0;
  Real forget_ = 0;
  Real noise_ = 0;
  Real viscous_ = 0;
  Real rest_ = 0;
  Real static_ = 0;
  Real per_stribeck_ = 0;
  Real per_knee_ = 0;
};

}  // namespace servosense
