// What a CNC is told about alarms: another spindle speed, less feed, or to hold the feed.
//
// Purpose: closes the loop from the monitors to the overrides of a control, inside limits that the
// user sets. One step after another, each with patience_s to end the alarm:
//   chatter    an advised speed, the first two that are given (stability lobes)
//              sinusoidal variation of the speed, n = n0 (1 + A sin 2 pi f t)
//                (Sexton and Stone 1978; Altintas and Chan 1992)
//              less feed, then a feed hold: no stable speed is known inside the limits
//   overload   less feed while the load is above 1, more below load_release; a feed hold where the
//              least feed does not help. It goes to f m / load, f being the feed in effect
//              and m the middle of 1 and load_release, and back no farther than there: torque is at
//              most in proportion to the feed, and a command that is still on its way to the
//              machine is not given twice
//   collision  a feed hold, with the sample
// Where nothing is left to try, a second chatter alarm in the same cut holds at once.
// Chips never get thicker: where the control feeds per minute, the feed follows a slower spindle,
// or stays at that of its slowest moment while it varies.
// A speed that has ended the chatter is kept until the cut ends, for at the programmed one the
// chatter would come back. Only an operator ends a hold. An operator who moves an override wins:
// his setting is the new 1, and nothing is commanded until the cut ends.
// Discretisation: differences of time steps; the sine is a rotation, its length corrected.
// Delay: none; from one ratio to another their difference over the rate.
// Cost: bench/firmware/instructions.csv.
// Range: least <= 1 <= greatest; A 2 pi f <= speed_rate_per_s.
// Numerical bound: ratios move by steps and are clamped; nothing accumulates.
// Faults: advice and loads that are not finite count as not given; nothing that is fed in latches.
// Bad at: knowing whether advice is right: it tries it. A variation that hides chatter from its
// monitor counts as one that has ended it. Not a safety function.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/core/units.hpp"
#include "servosense/core/whole.hpp"

namespace servosense {

/// Ratios are to what the program says. Nothing is allowed unless it is set.
struct OverrideConfig {
  double sample_period_s = 125e-6;
  double least_speed = 1, greatest_speed = 1;
  double least_feed = 1, greatest_feed = 1;
  double speed_rate_per_s = 0.5;   ///< greatest change of the speed (Koike 2016, ch. 8)
  double feed_rate_per_s = 0.5;    ///< and of the feed
  double variation_amplitude = 0;  ///< A of the speed variation, of the programmed speed; 0: none
  double variation_hz = 1;         ///< f
  double patience_s = 0.5;         ///< for a step to end the alarm, once it is there
  double return_s = 1;             ///< after alarm or cut, before the programmed values come back
  double load_release = 0.9;       ///< load below which the feed comes back
  double load_cutoff_rad_s = 25;   ///< of the load, as CutDetectorConfig has it
  bool feed_per_minute = true;     ///< G94: the feed does not follow the spindle by itself
};

enum class OverridePhase : std::uint8_t {
  programmed,  ///< as the program says, or on the way back to it
  advised,     ///< to or at an advised speed
  varying,     ///< sinusoidal speed variation
  reduced,     ///< nothing is left to try: least feed
  yielded,     ///< the operator has moved an override: nothing is commanded
};

/// Ends with a null character.
[[nodiscard]] constexpr const char* name_of(OverridePhase phase) noexcept {
  constexpr const char* kNames[] = {"programmed", "advised", "varying", "reduced", "yielded"};
  return kNames[static_cast<std::size_t>(phase)];
}

template <RealNumber Real>
struct OverrideInput {
  static constexpr Real kUnknown = std::numeric_limits<Real>::quiet_NaN();
  bool chatter = false;    ///< its alarm stands
  bool collision = false;  ///< its alarm stands
  bool in_cut = true;      ///< as far as is known
  Real load = kUnknown;    ///< over what it may be; NaN: not known
  /// Feed ratio that the machine has now, acknowledged by its control; NaN: the commanded one.
  Real feed_in_effect = kUnknown;
  /// Speed ratios to try, the best first; NaN: none. To be kept until the cut ends.
  std::array<Real, 2> advised{kUnknown, kUnknown};
  /// It is being looked for: nothing is given up meanwhile, for `patience_s` at most.
  bool advice_pending = false;
  bool resume = false;      ///< its rising edge: the operator lets the feed go on
  bool taken_over = false;  ///< the operator has moved an override
};

template <RealNumber Real>
class OverrideControl {
 public:
  using Config = OverrideConfig;
  using Input = OverrideInput<Real>;
  struct State {
    Real speed_ratio = 1;  ///< to be commanded
    Real feed_ratio = 1;   ///< to be commanded
    bool hold = false;     ///< the feed is to be held
    OverridePhase phase = OverridePhase::programmed;
    bool exhausted = false;   ///< no stable speed is known inside the limits; until the cut ends
    bool overloaded = false;  ///< the load has brought the feed down
    Real chips = 1;           ///< thickness in effect, of the programmed one, as the load shows it
    bool arrived = true;      ///< feed_ratio is what it is to be
    Real target = 1;          ///< advised speed
    Real load_feed = 1;       ///< feed ratio for the load
    Real cosine = 1, sine = 0;               // of the variation
    std::uint8_t tried = 0;                  // advised 1 and 2, and 4: variation
    bool collision = false, resume = false;  // of the sample before
    std::uint32_t waited = 0;                // samples with the alarm in spite of the present step
    std::uint32_t over = 0;                  // samples above the load in spite of the least feed
    std::uint32_t quiet = 0;                 // samples that let the present step end
    std::uint32_t light = 0;                 // samples below load_release
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.sample_period_s > 0 && is_finite(c.sample_period_s)))
      return Status::invalid("sample_period_s", "must be positive");
    if (!(c.least_speed > 0 && c.least_speed <= 1))
      return Status::invalid("least_speed", "must be above 0 and at most 1");
    if (!(c.greatest_speed >= 1 && c.greatest_speed <= 4))
      return Status::invalid("greatest_speed", "must be within 1 and 4");
    if (!(c.least_feed > 0 && c.least_feed <= 1))
      return Status::invalid("least_feed", "must be above 0 and at most 1");
    if (!(c.greatest_feed >= 1 && c.greatest_feed <= 4))
      return Status::invalid("greatest_feed", "must be within 1 and 4");
    if (!(c.speed_rate_per_s > 0 && is_finite(c.speed_rate_per_s)))
      return Status::invalid("speed_rate_per_s", "must be positive");
    if (!(c.feed_rate_per_s > 0 && is_finite(c.feed_rate_per_s)))
      return Status::invalid("feed_rate_per_s", "must be positive");
    if (c.feed_per_minute && c.least_feed > c.least_speed)
      return Status::invalid("least_feed",
                             "must be at most least_speed: a slower spindle at the same feed per "
                             "minute takes thicker chips");
    if (c.feed_per_minute && c.feed_rate_per_s < c.speed_rate_per_s)
      return Status::invalid("feed_rate_per_s",
                             "must be at least speed_rate_per_s: the feed follows the spindle");
    const double range = c.greatest_speed - c.least_speed;
    if (!(c.variation_amplitude >= 0 && 2 * c.variation_amplitude <= range))
      return Status::invalid("variation_amplitude",
                             "must be at least 0 and fit twice between least and greatest speed");
    if (!(c.variation_hz > 0 &&
          kTwoPi * c.variation_hz * c.variation_amplitude <= c.speed_rate_per_s))
      return Status::invalid("variation_hz",
                             "must be positive, and 2 pi times it times the amplitude at most "
                             "speed_rate_per_s");
    if (!(c.variation_hz * c.sample_period_s < 0.05))
      return Status::invalid("variation_hz", "must be below a twentieth of the sample rate");
    if (!(c.patience_s >= 0 && c.patience_s < kMostSamples * c.sample_period_s))
      return Status::invalid("patience_s", "must be at least 0, below a billion samples");
    if (!(c.return_s >= 0 && c.return_s < kMostSamples * c.sample_period_s))
      return Status::invalid("return_s", "must be at least 0, below a billion samples");
    if (!(c.load_release > 0 && c.load_release < 1))
      return Status::invalid("load_release", "must be within 0 and 1");
    if (!(c.load_cutoff_rad_s > 0 && is_finite(c.load_cutoff_rad_s)))
      return Status::invalid("load_cutoff_rad_s", "must be positive");
    return {};
  }
  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    least_speed_ = static_cast<Real>(c.least_speed);
    greatest_speed_ = static_cast<Real>(c.greatest_speed);
    least_feed_ = static_cast<Real>(c.least_feed);
    greatest_feed_ = static_cast<Real>(c.greatest_feed);
    speed_step_ = static_cast<Real>(c.speed_rate_per_s * c.sample_period_s);
    feed_step_ = static_cast<Real>(c.feed_rate_per_s * c.sample_period_s);
    amplitude_ = static_cast<Real>(c.variation_amplitude);
    // About the programmed speed, or as near to it as the limits let it be.
    const double low = c.least_speed + c.variation_amplitude;
    const double high = c.greatest_speed - c.variation_amplitude;
    centre_ = static_cast<Real>(low > 1 ? low : high < 1 ? high : 1);
    const double turn = kTwoPi * c.variation_hz * c.sample_period_s;
    turn_cosine_ = static_cast<Real>(std::cos(turn));
    turn_sine_ = static_cast<Real>(std::sin(turn));
    patience_ = samples(c.patience_s, c.sample_period_s);
    // A variation shows what it does in a whole period.
    const double period_s = 1 / c.variation_hz;
    varying_patience_ =
        samples(period_s > c.patience_s ? period_s : c.patience_s, c.sample_period_s);
    return_ = samples(c.return_s, c.sample_period_s);
    release_ = static_cast<Real>(c.load_release);
    const double heard = c.load_cutoff_rad_s * c.sample_period_s;
    chips_gain_ = static_cast<Real>(heard / (1 + heard));
    middle_ = static_cast<Real>((1 + c.load_release) / 2);
    per_minute_ = c.feed_per_minute;
    reset();
  }
  void reset() noexcept { state_ = State{}; }

  /// One servo period.
  const State& process(const Input& in) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    const bool resumed = in.resume && !s.resume;
    if (resumed) s.hold = false;
    if (in.collision && !s.collision) s.hold = true;
    s.resume = in.resume;
    s.collision = in.collision;
    if (in.taken_over) yield();
    see_chips(in.feed_in_effect);
    if (resumed) s.waited = s.over = 0;
    const bool loaded = is_finite(in.load) && in.load > Real(1);
    if (s.phase == OverridePhase::yielded) {
      s.quiet = in.chatter || loaded || in.in_cut ? 0 : s.quiet + 1;
      if (s.quiet >= return_) end_cut();
    } else {
      hear_chatter(in);
      hear_load(loaded, in.load);
    }
    move();
    return s;
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  static constexpr double kMostSamples = 1e9;
  static constexpr std::uint8_t kTriedVariation = 4;

  static std::uint32_t samples(double time_s, double period_s) noexcept {
    const std::uint32_t n = nearest_whole(time_s / period_s);
    return n > 0 ? n : 1;
  }

  // What the operator has set is the new 1.
  void yield() noexcept {
    State& s = state_;
    s.phase = OverridePhase::yielded;
    s.speed_ratio = s.feed_ratio = s.target = s.load_feed = s.chips = Real(1);
    s.overloaded = false;
    s.waited = s.over = s.quiet = s.light = 0;
  }
  void end_cut() noexcept {
    State& s = state_;
    s.phase = OverridePhase::programmed;
    s.exhausted = false;
    s.tried = 0;
    s.waited = s.quiet = 0;
  }

  void hear_chatter(const Input& in) noexcept {
    State& s = state_;
    if (!in.chatter) {
      if (s.waited > 0) --s.waited;
      // The alarm has a hysteresis of its own, and less feed ends no chatter.
      if (s.phase == OverridePhase::reduced) s.phase = OverridePhase::programmed;
      s.quiet = in.in_cut ? 0 : s.quiet + (s.quiet < return_);
      if (s.quiet >= return_) end_cut();
      return;
    }
    s.quiet = 0;
    switch (s.phase) {
      case OverridePhase::programmed:
        if (advise(in)) return;
        if (in.advice_pending && s.waited < patience_)
          ++s.waited;
        else
          next_step(in);
        return;
      case OverridePhase::advised:
        if (s.speed_ratio == s.target && ++s.waited >= patience_) next_step(in);
        return;
      case OverridePhase::varying:
        if (advise(in)) return;
        if (++s.waited >= varying_patience_) next_step(in);
        return;
      case OverridePhase::reduced:
        if (advise(in)) return;
        s.waited += s.waited < patience_;
        if (s.waited >= patience_) s.hold = true;
        return;
      case OverridePhase::yielded:
        return;
    }
  }
  void next_step(const Input& in) noexcept {
    State& s = state_;
    if (advise(in)) return;
    s.waited = 0;
    if (amplitude_ > 0 && (s.tried & kTriedVariation) == 0) {
      s.tried |= kTriedVariation;
      s.phase = OverridePhase::varying;
      s.cosine = 1;
      s.sine = 0;
      return;
    }
    // Less feed makes chatter smaller and does not end it: an alarm that comes again is the proof.
    if (s.exhausted) s.hold = true;
    s.phase = OverridePhase::reduced;
    s.exhausted = true;
  }
  // An advised speed inside the limits that has not been tried in this cut.
  bool advise(const Input& in) noexcept {
    State& s = state_;
    for (std::size_t i = 0; i < in.advised.size(); ++i) {
      const auto bit = static_cast<std::uint8_t>(1U << i);
      const Real to = in.advised[i];
      if ((s.tried & bit) != 0 || !(to >= least_speed_ && to <= greatest_speed_)) continue;
      s.tried |= bit;
      s.phase = OverridePhase::advised;
      s.target = to;
      s.waited = 0;
      s.exhausted = false;
      return true;
    }
    return false;
  }

  // Low-passed as the load is.
  void see_chips(Real feed) noexcept {
    State& s = state_;
    if (!(feed > 0 && is_finite(feed))) feed = s.feed_ratio;
    s.chips += chips_gain_ * ((per_minute_ ? feed / s.speed_ratio : feed) - s.chips);
  }
  void hear_load(bool loaded, Real load) noexcept {
    State& s = state_;
    if (loaded) {
      s.light = 0;
      s.overloaded = true;
      const Real enough = s.chips * middle_ / load;
      if (enough < s.load_feed) s.load_feed = enough > least_feed_ ? enough : least_feed_;
      if (!s.arrived || (s.load_feed > least_feed_ && s.feed_ratio > least_feed_)) return;
      s.over += s.over < patience_;
      if (s.over >= patience_) s.hold = true;
      return;
    }
    s.over = 0;
    if (!s.overloaded || (is_finite(load) && load >= release_)) {
      s.light = 0;
      return;
    }
    s.light += s.light < return_;
    if (s.light < return_) return;
    const Real more = s.load_feed + feed_step_;
    if (is_finite(load) && more * load > s.chips * middle_) return;
    s.load_feed = more;
    if (s.load_feed >= 1) {
      s.load_feed = 1;
      s.overloaded = false;
    }
  }

  void move() noexcept {
    State& s = state_;
    if (s.phase == OverridePhase::yielded) return;
    Real speed = 1;
    if (s.phase == OverridePhase::advised) speed = s.target;
    if (s.phase == OverridePhase::varying) {
      const Real c = s.cosine * turn_cosine_ - s.sine * turn_sine_;
      const Real q = s.sine * turn_cosine_ + s.cosine * turn_sine_;
      const Real length = Real(1.5) - Real(0.5) * (c * c + q * q);
      s.cosine = length * c;
      s.sine = length * q;
      speed = centre_ + amplitude_ * s.sine;
    }
    s.speed_ratio =
        within(towards(s.speed_ratio, speed, speed_step_), least_speed_, greatest_speed_);
    Real feed = s.phase == OverridePhase::reduced ? least_feed_ : s.load_feed;
    // While the speed varies the feed is that of its slowest moment: in an uneven feed the chatter
    // monitor hears no line and less power.
    const Real pace = s.phase == OverridePhase::varying ? centre_ - amplitude_ : s.speed_ratio;
    if (per_minute_) feed *= pace < greatest_feed_ ? pace : greatest_feed_;
    feed = within(feed, least_feed_, greatest_feed_);
    s.feed_ratio = within(towards(s.feed_ratio, feed, feed_step_), least_feed_, greatest_feed_);
    s.arrived = s.feed_ratio == feed;
  }
  static Real towards(Real from, Real to, Real step) noexcept {
    if (to > from + step) return from + step;
    if (to < from - step) return from - step;
    return to;
  }
  static Real within(Real value, Real low, Real high) noexcept {
    return value < low ? low : value > high ? high : value;
  }

  State state_;
  Real least_speed_ = 1, greatest_speed_ = 1, least_feed_ = 1, greatest_feed_ = 1;
  Real speed_step_ = 0, feed_step_ = 0;
  Real amplitude_ = 0, centre_ = 1, turn_cosine_ = 1, turn_sine_ = 0;
  Real release_ = 1, middle_ = 1, chips_gain_ = 1;
  std::uint32_t patience_ = 1, varying_patience_ = 1, return_ = 1;
  bool per_minute_ = true;
};

}  // namespace servosense
