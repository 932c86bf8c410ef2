// Dynamometer compensation: the force on a dynamometer from the force that it measures.
//
// Purpose: a dynamometer is a spring-mass system of its own: near its natural frequency it reports
// many times the force, above it a fraction. A force that repeats with the spindle's turn is found
// again at all of its harmonics, n = 0..N.
// Equation: Kalman filter over modal blocks of the dynamometer and harmonics of the spindle
// (Dunwoody 2010, eq. 5.27 to 5.63), in coordinates in which both stand apart. With the harmonics
// a_n of the force over the spindle's angle p, F = sum Re(a_n e^(jnp)), the dynamometer reports
//   y = sum Re(H(jnw) a_n e^(jnp)) + sum r_k
// w the speed, r_k what a mode still rings by itself. Per sample, e the measured force less this:
//   a_n += K_n e^(-jnp) e,   K_n = g_n conj(H(jnw)) / |H(jnw)|,   r_k += L_k e
// In the steady state the estimate is F itself for every gain: |G H - 1| = 0 at n = 0..N.
// Gains: without others g = 2 b T / S for n > 0, that over sqrt(2) for the mean, b = w / (2 pi
// averaged_turns), S = 1 + sum g_n |H_n|, L = 0: the limit of the Kalman gains for slow averaging.
// They need no Riccati equation, so they follow any speed; and they cannot become unstable: with
// P = diag(g_n / |H_n|) every sample lowers sum |a_n error|^2 / P_n. Against the Kalman filter of
// one speed (observer/dynamometer_design.hpp) the error is 2 % larger at 3 turns, 0.2 % at 10.
// `DynamometerGain` of one speed, computed there, is used within the range of speeds that it holds.
// Discretisation: exact. The harmonics stand over the angle, ringing modes turn by e^(sT).
// Delay: none for a force that repeats. A change is followed with a time constant of
// averaged_turns / |H| turns.
// Cost on Cortex-M7: 1188 instructions for 5 modes and 12 harmonics, 1213 at worst (M4F 1174).
// Range: a turning spindle, from 8 samples a turn; harmonics above 0.8 of half the sample rate are
// left out. Damping ratios below 1. Speeds that change by less than 10 % a turn.
// Numerical bound: contraction, no drift; angles enter as they come, nothing is summed over turns.
// Noise: standard deviation of the estimate over that of the measured force
// sqrt((sum 1/|H_n| + 0.7) / (samples a turn, times averaged_turns)): one number, averaged_turns,
// sets noise against bandwidth.
// Bad at: forces that do not repeat with the turn (chatter, a single hit), harmonics beyond N, a
// harmonic where H is nearly zero (it settles in averaged_turns / |H| turns, below
// kLeastResponse it is left out and counted), modes that are off (5 % of frequency: see
// docs/dynamometer.md), a standing spindle (the measured force is returned).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/fast_math.hpp"
#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/rotational_filter.hpp"
#include "servosense/model/dynamometer_mode.hpp"

namespace servosense {

inline constexpr std::size_t kMostDynamometerModes = 8;
inline constexpr std::size_t kMostDynamometerHarmonics = 64;

struct DynamometerFilterConfig {
  double sample_period_s = 1 / 25600.;
  std::size_t modes = 0;  ///< used of `mode`; 0: an ideal dynamometer
  std::array<DynamometerMode, kMostDynamometerModes> mode{};
  std::size_t harmonics = 12;  ///< N, at least 3 times the teeth
  double averaged_turns = 3;   ///< time constant; the noise falls with its root
};

struct ComplexGain {
  double re = 0, im = 0;
};

/// Kalman gains of one speed (design_dynamometer_gain()), in units of the block's own.
struct DynamometerGain {
  double from_rad_s = 0, to_rad_s = 0;  ///< speeds, either sense, at which they hold; none: unused
  std::array<ComplexGain, kMostDynamometerHarmonics + 1> harmonic{};
  std::array<ComplexGain, kMostDynamometerModes> ringing{};
};

template <RealNumber Real, std::size_t Modes = kMostDynamometerModes,
          std::size_t Harmonics = kMostDynamometerHarmonics>
class DynamometerFilter {
  static_assert(Modes <= kMostDynamometerModes && Harmonics <= kMostDynamometerHarmonics);

 public:
  using Config = DynamometerFilterConfig;
  struct Complex {
    Real re = 0, im = 0;
  };
  /// Below this |H| the dynamometer does not see a harmonic: a force would have to be a thousand
  /// times the noise.
  static constexpr double kLeastResponse = 1e-3;
  /// Harmonics up to this part of half the sample rate are used.
  static constexpr double kHighestShare = 0.8;

  struct State {
    Real estimate = 0;                              ///< applied force [N]
    std::array<Complex, Harmonics + 1> force{};     ///< a_n [N] over the spindle's angle
    std::array<Complex, Modes> ringing{};           ///< [N]
    std::array<Complex, Harmonics + 1> response{};  ///< H(jnw)
    Real increment = 0;                             ///< mean turn of the spindle a sample [rad]
    Real slowest = 1;           ///< least |H_n| of those used: averaged_turns / this settles all
    std::size_t harmonics = 0;  ///< highest one used, as the sample rate allows
    std::size_t unseen = 0;     ///< of those, at a zero of H and left out
    Real turned_rad = 0;        ///< since the last restart, stops when settled
    std::uint64_t held = 0;     ///< samples whose value or angle was unusable
    Quality quality = Quality::settling;
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0 && c.sample_period_s < 1))
      return Status::invalid("sample_period_s", "must be within 0 and 1 s");
    if (c.modes > Modes) return Status::invalid("modes", "must fit the block's capacity");
    if (c.harmonics < 1 || c.harmonics > Harmonics)
      return Status::invalid("harmonics", "must be within 1 and the block's capacity");
    if (!(c.averaged_turns >= 0.5 && c.averaged_turns <= 1000))
      return Status::invalid("averaged_turns", "must be within 0.5 and 1000");
    for (std::size_t k = 0; k < c.modes; ++k) {
      const DynamometerMode& m = c.mode[k];
      if (!(m.natural_frequency_hz > 0 && m.natural_frequency_hz * c.sample_period_s < 0.5))
        return Status::invalid("natural_frequency_hz",
                               "must be above 0 and below half the sample rate");
      if (!(m.damping_ratio > 0 && m.damping_ratio < 1))
        return Status::invalid("damping_ratio", "must be within 0 and 1");
      if (!(m.share >= -100 && m.share <= 100))
        return Status::invalid("share", "must be within -100 and 100");
    }
    return {};
  }
  /// Requires validate(c).ok(). `gain`: of one speed, where there is one.
  void configure(const Config& c, const DynamometerGain& gain = {}) noexcept {
    modes_ = c.modes;
    harmonics_ = c.harmonics;
    direct_ = 1;
    double direct = 1;
    for (std::size_t k = 0; k < c.modes; ++k) {
      const DynamometerMode& m = c.mode[k];
      const double w = kTwoPi * m.natural_frequency_hz;
      const double damped = w * std::sqrt(1 - m.damping_ratio * m.damping_ratio);
      const double decay = std::exp(-m.damping_ratio * w * c.sample_period_s);
      direct -= m.share;
      mode_[k].ratio = static_cast<Real>(1 / (w * c.sample_period_s));
      mode_[k].damping = static_cast<Real>(2 * m.damping_ratio);
      mode_[k].share = static_cast<Real>(m.share);
      mode_[k].turn = {static_cast<Real>(decay * std::cos(damped * c.sample_period_s)),
                       static_cast<Real>(decay * std::sin(damped * c.sample_period_s))};
      ringing_gain_[k] = narrow(gain.ringing[k]);
    }
    direct_ = static_cast<Real>(direct);
    from_ = static_cast<Real>(gain.from_rad_s * c.sample_period_s);
    to_ = static_cast<Real>(gain.to_rad_s * c.sample_period_s);
    for (std::size_t n = 0; n <= harmonics_; ++n) designed_[n] = narrow(gain.harmonic[n]);
    step_per_rad_ = static_cast<Real>(2 / (kTwoPi * c.averaged_turns));
    settled_rad_ = static_cast<Real>(kTwoPi * kSettlingConstants * c.averaged_turns);
    reset();
  }

  void reset() noexcept {
    state_ = State{};
    next_ = 0;
    filled_ = false;
    started_ = false;
    round_ = Round{};
    used_ = Round{};
    for (Complex& u : unit_) u = {};
  }

  /// Returns the applied force [N]: `force` [N] measured where the spindle stands at `angle_rad`,
  /// within [-2 pi, 4 pi], having turned `increment_rad` since the sample before. While the
  /// responses of the first speed are computed, one a sample, and while the spindle stands, the
  /// measured force. For a force that
  /// is unusable the harmonics go on; for an angle that is, the last estimate stays.
  Real process(Real force, Real angle_rad, Real increment_rad,
               Quality quality = Quality::good) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.quality = quality;
    const bool turns = fits(angle_rad) && is_moderate(increment_rad);
    if (!turns) {
      ++s.held;
      s.quality |= Quality::invalid;
      return s.estimate;
    }
    if (has(quality, Quality::restarted)) restart();
    if (has(quality, Quality::gap | Quality::restarted))
      for (Complex& r : s.ringing) r = {};
    else
      follow_speed(increment_rad);
    renew_response();
    const bool usable = is_moderate(force) && !has(quality, kUnusable);
    if (!usable) {
      ++s.held;
      s.quality |= is_moderate(force) ? Quality::good : Quality::invalid;
    }
    if (!filled_ || magnitude(s.increment) < kStanding) {
      s.quality |= Quality::settling;
      return s.estimate = usable ? force : s.estimate;
    }
    if (s.turned_rad < settled_rad_) {
      s.turned_rad += magnitude(increment_rad);
      s.quality |= Quality::settling;
    }
    return advance(force, angle_rad, usable);
  }

  /// Measured over applied force at the angle `turn_rad` a sample: H(j turn / T).
  [[nodiscard]] Complex response(Real turn_rad) const noexcept {
    Complex h{direct_, 0};
    for (std::size_t k = 0; k < modes_; ++k) {
      const Real r = turn_rad * mode_[k].ratio;
      const Real a = Real(1) - r * r;
      const Real b = mode_[k].damping * r;
      const Real scale = mode_[k].share / (a * a + b * b);
      h.re += scale * a;
      h.im -= scale * b;
    }
    return h;
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  static constexpr double kSettlingConstants = 5;  // leaves 0.7 % of the start where |H| is 1
  static constexpr Real kStanding = Real(1e-6);    // rad a sample: 0.2 rpm at 25.6 kHz
  static constexpr Real kMeanGain = Real(0.70710678118654752);
  // The speed is a mean over about half a turn: between two samples an encoder knows it poorly.
  static constexpr Real kSpeedShare = Real(0.31830988618379067);

  struct Mode {
    Real ratio = 0, damping = 0, share = 0;
    Complex turn;
  };
  // Of one round through the harmonics.
  struct Round {
    Real sum = 0;      // of g_n |H_n|, in steps
    Real slowest = 1;  // |H_n|
    std::size_t unseen = 0;
  };

  static Complex narrow(const ComplexGain& g) noexcept {
    return {static_cast<Real>(g.re), static_cast<Real>(g.im)};
  }
  static Real magnitude(Real v) noexcept { return v < 0 ? -v : v; }
  static bool fits(Real angle) noexcept {
    return angle >= Real(-kTwoPi) && angle <= Real(2 * kTwoPi);
  }
  static Complex times(const Complex& a, const Complex& b) noexcept {
    return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
  }

  void restart() noexcept {
    state_.turned_rad = 0;
    started_ = false;
  }

  void follow_speed(Real increment) noexcept {
    Real& mean = state_.increment;
    if (!started_) {
      mean = increment;
      started_ = true;
      return;
    }
    const Real now = magnitude(increment), before = magnitude(mean);
    const Real share = kSpeedShare * (now > before ? now : before);
    mean += (share < Real(1) ? share : Real(1)) * (increment - mean);
  }

  // One harmonic a sample: its response at the mean speed, and the direction of its gain.
  void renew_response() noexcept {
    State& s = state_;
    const Real turn = static_cast<Real>(next_) * s.increment;
    const bool within = magnitude(turn) < static_cast<Real>(kHighestShare * kTwoPi / 2);
    if (within) {
      const Complex h = s.response[next_] = response(turn);
      const Real size = length_of(PlaneVector<Real>{h.re, h.im});
      const bool seen = size >= static_cast<Real>(kLeastResponse);
      const Real per_size = seen ? Real(1) / size : Real(0);
      const Real own = next_ == 0 ? kMeanGain : Real(1);
      unit_[next_] = {own * per_size * h.re, -own * per_size * h.im};
      round_.sum += own * size;
      if (!seen)
        ++round_.unseen;
      else if (size < round_.slowest)
        round_.slowest = size;
    }
    if (within && next_ < harmonics_) {
      ++next_;
      return;
    }
    s.harmonics = within ? next_ : next_ - 1;
    s.unseen = round_.unseen;
    s.slowest = round_.slowest;
    used_ = round_;
    round_ = Round{};
    next_ = 0;
    filled_ = true;
  }

  Real advance(Real measured, Real angle, bool usable) noexcept {
    State& s = state_;
    const SineCosine<Real> turn = sine_cosine(angle);
    const Complex first{turn.cosine, turn.sine};
    Real expected = 0;
    for (std::size_t k = 0; k < modes_; ++k) {
      s.ringing[k] = times(s.ringing[k], mode_[k].turn);
      expected += s.ringing[k].re;
    }
    Real estimate = 0;
    Complex e{1, 0};
    for (std::size_t n = 0; n <= s.harmonics; ++n) {
      const Complex z = times(s.force[n], e);
      estimate += z.re;
      expected += s.response[n].re * z.re - s.response[n].im * z.im;
      e = times(e, first);
    }
    if (!usable) return s.estimate = estimate;
    const Real turned = magnitude(s.increment);
    const Real step = step_per_rad_ * turned;
    const Real error = step / (Real(1) + step * used_.sum) * (measured - expected);
    const bool designed = turned >= from_ && turned <= to_ && to_ > 0;
    if (designed)
      for (std::size_t k = 0; k < modes_; ++k) {
        s.ringing[k].re += ringing_gain_[k].re * error;
        s.ringing[k].im += ringing_gain_[k].im * error;
      }
    e = {1, 0};
    for (std::size_t n = 0; n <= s.harmonics; ++n) {
      const Complex gain = designed ? times(unit_[n], designed_[n]) : unit_[n];
      estimate += gain.re * error;
      s.force[n].re += (gain.re * e.re + gain.im * e.im) * error;
      s.force[n].im += (gain.im * e.re - gain.re * e.im) * error;
      e = times(e, first);
    }
    s.force[0].im = 0;
    return s.estimate = estimate;
  }

  State state_;
  std::array<Complex, Harmonics + 1> unit_{};  // conj(H_n) / |H_n|, times the share of the mean
  std::array<Complex, Harmonics + 1> designed_{};
  std::array<Complex, Modes> ringing_gain_{};
  std::array<Mode, Modes> mode_{};
  Real direct_ = 1;
  Real step_per_rad_ = 0;
  Real settled_rad_ = 0;
  Real from_ = 0, to_ = 0;
  std::size_t modes_ = 0;
  std::size_t harmonics_ = 0;
  std::size_t next_ = 0;
  Round round_, used_;
  bool filled_ = false;
  bool started_ = false;
};

}  // namespace servosense
