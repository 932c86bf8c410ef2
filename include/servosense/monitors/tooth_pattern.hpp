// Pattern of a broken tooth in the mean force of each quarter of a tooth
// period.
//
// Purpose: the part of monitors/tooth_breakage.hpp that decides, from parts of
// the turn on; its equations, sources and limits stand there. An alarm is
// replayed from it. Discretisation: a part comes four times a tooth period;
// begin() takes it, work() does the rest in three calls, so that no servo
// sample pays for all of it. Delay: that of the averages, a tooth period. Cost:
// in that of the monitor; the averages over the teeth are sums of m terms.
// Range: parts that follow each other; |x| < 1e9. Numerical bound: sums live
// for one revolution.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/dsp/tooth_immersion.hpp"
#include "servosense/monitors/monitor.hpp"

namespace servosense {

struct ToothBreakageConfig {
  double sample_period_s = 125e-6;
  unsigned teeth = 4;   ///< m
  bool torque = false;  ///< process(torque, ...) is called, not process(x, y, ...)
  /// Standard deviation of the signal's mean over a tooth period with the
  /// spindle idling, in the unit of the signal; learned. 0 = off, monitor
  /// idles.
  double noise = 0;
  /// Standard deviation of a sample of the idling spindle, same unit, less
  /// `noise`; learned.
  double sample_noise = 0;
  double minimum_speed_rad_s = 5;  ///< slower than this the monitor idles
  double tolerated_throw = 0.1;    ///< of a tooth, as a part of the feed per tooth
  double swept_angle_rad = 0;      ///< of every cut, when known; 0: estimated from the shape
  double new_fraction = 0.5;       ///< of the threshold, that must be new in a pattern
  double noise_factor = 8;         ///< of `noise`, that a pattern must exceed besides
  /// In which the mean falls to 1/e after the force is gone, or four
  /// revolutions if those take longer: longer than the feed takes to stop, when
  /// run-out alone still cuts.
  double memory_s = 1;
  double threshold = 1;                  ///< of value; 0 = off
  double warning_fraction = 0.75;        ///< of the threshold
  double release_fraction = 0.5;         ///< of the threshold
  unsigned release_revolutions = 4;      ///< below the release level before an alarm ends
  unsigned consecutive_revolutions = 3;  ///< with a pattern that is not new, before it is told
  unsigned teaching_revolutions = 8;     ///< length of an interval of the limit pattern
  double teaching_factor = 1.5;          ///< of the taught limits
};

/// A quarter of a tooth period, as the detector sees it and an alarm is
/// replayed from.
template <RealNumber Real>
struct ToothPart {
  Real x = 0;
  Real y = 0;
  Real deviation = 0;  ///< standard deviation of x and y within the part
  Real swept_rad = 0;  ///< told; 0: estimate
  std::uint32_t samples = 0;
  Real low = 0;  ///< taught limits of Delta
  Real high = 0;
  bool matching = false;
  bool first = false;  ///< nothing goes before it
};

/// Everything that decides, from parts of the turn on.
template <RealNumber Real, std::size_t MaxTeeth>
class ToothPattern {
  static_assert(MaxTeeth >= 2 && MaxTeeth <= 32);

 public:
  using Config = ToothBreakageConfig;
  using Input = ToothPart<Real>;
  static constexpr unsigned kPartsPerTooth = 4;
  using Immersion = ToothImmersion<Real, MaxTeeth, kPartsPerTooth>;
  static constexpr unsigned kReach = Immersion::kReach;
  static constexpr std::size_t kRing =
      kPartsPerTooth * (MaxTeeth + (MaxTeeth > kReach + 1 ? MaxTeeth : kReach + 1)) + 1;

  struct State {
    MonitorState state = MonitorState::idle;
    SignalState signal = SignalState::filling;
    Real value = 0;           ///< size of a new pattern over what is tolerated of it
    Real level = 0;           ///< D
    Real difference = 0;      ///< Delta
    Real mean = 0;            ///< of D over the last revolution
    Real usual = 0;           ///< the same, slow to fall
    Real forgotten = 0;       ///< part of a slow value that this part of the turn takes away
    Real tolerated = 0;       ///< size of a pattern: threshold * mean, slow to fall
    Real restless = 0;        ///< mean square of what was new in Delta before the pattern
    Real growth = 0;          ///< of the mean since the last revolution, beyond a tenth of it
    Real ratio = 0;           ///< size of the pattern, new or not, over `mean` (Tarng 1988, 7.2)
    Real threshold = 2;       ///< of `ratio`
    Real shape = 0;           ///< u of dsp/tooth_immersion.hpp; 0: not known
    Real swept_rad = 0;       ///< told, or estimated from the shape
    std::uint32_t parts = 0;  ///< since the start, until the windows are full
    std::uint32_t part = 0;   ///< of the tooth period under way
    std::uint32_t tooth = 0;  ///< where the ring of teeth goes on
    std::uint32_t next = 0;   ///< where the ring of levels goes on
    std::uint32_t turn = 0;   ///< parts of this revolution
    Real most = 0;            ///< largest pattern of this revolution, over what is tolerated
    // Parts of the last revolution, and their means over all teeth.
    std::array<std::array<Real, MaxTeeth>, kPartsPerTooth> turn_x{};
    std::array<std::array<Real, MaxTeeth>, kPartsPerTooth> turn_y{};
    std::array<std::array<Real, MaxTeeth>, kPartsPerTooth> turn_deviation{};
    std::array<Real, kPartsPerTooth> profile_x{};
    std::array<Real, kPartsPerTooth> profile_y{};
    std::array<Real, kPartsPerTooth> profile_deviation{};
    std::array<Real, kPartsPerTooth> x{};
    std::array<Real, kPartsPerTooth> y{};
    std::array<Real, kRing> levels{};  // D
  };

  /// All that changes from part to part; the rest follows from the
  /// configuration.
  struct Memory {
    AlarmLogic<Real> fresh;
    AlarmLogic<Real> lasting;
    State state;
  };
  [[nodiscard]] const Memory& memory() const noexcept { return memory_; }
  /// As it was then. Requires that nothing is pending.
  void restore(const Memory& memory) noexcept {
    memory_ = memory;
    stage_ = 0;
  }

  void configure(const Config& c) noexcept {
    immersion_.configure({c.teeth, c.tolerated_throw, c.torque});
    teeth_ = c.teeth;
    const unsigned reach = c.teeth > kReach + 1 ? c.teeth : kReach + 1;
    ring_ = (c.teeth + reach) * kPartsPerTooth + 1;
    torque_ = c.torque;
    // What the noise adds to the variance within the parts of a tooth period.
    sample_noise_ = static_cast<Real>(kPartsPerTooth * c.sample_noise * c.sample_noise);
    floor_ = static_cast<Real>(c.noise * c.noise_factor);
    told_ = static_cast<Real>(c.swept_angle_rad);
    inverse_fraction_ = static_cast<Real>(1 / c.new_fraction);
    inverse_teeth_ = static_cast<Real>(1.0 / c.teeth);
    inverse_turn_ = static_cast<Real>(1.0 / (c.teeth * kPartsPerTooth));
    restless_ = static_cast<Real>(c.noise_factor * kGrows);
    forget_per_sample_ = static_cast<Real>(c.sample_period_s / c.memory_s);
    forget_most_ = static_cast<Real>(0.25 / (c.teeth * kPartsPerTooth));
    teaching_ = static_cast<Real>(c.teaching_factor);
    const double threshold = c.noise > 0 ? c.threshold : 0;
    memory_.fresh.configure({threshold, c.warning_fraction, c.release_fraction,
                             c.release_revolutions * c.teeth * kPartsPerTooth, 1});
    memory_.lasting.configure(
        {threshold, 1, c.release_fraction, c.release_revolutions, c.consecutive_revolutions});
    reset();
  }
  void reset() noexcept {
    memory_.fresh.reset();
    memory_.lasting.reset();
    memory_.state = State{};
    stage_ = 0;
  }
  /// Empties the windows, with the next work(); the alarm logic keeps its state.
  void forget() noexcept {
    if (memory_.state.parts > 0 || stage_ == kForget) {
      memory_.state.value = 0;
      stage_ = kForget;
    } else {
      stage_ = 0;
    }
  }
  /// Takes a part; work() does the rest, in three calls. Requires that nothing
  /// is pending.
  void begin(const Input& in) noexcept {
    if (in.first && memory_.state.parts > 0) empty();
    in_ = in;
    stage_ = 1;
  }
  [[nodiscard]] bool pending() const noexcept { return stage_ != 0; }
  /// True when this call has raised an alarm.
  bool work() noexcept {
    if (stage_ == 1) {
      average();
      average_teeth();
      stage_ = 2;
    } else if (stage_ == 2) {
      compare_turns();
      if (memory_.state.part == kPartsPerTooth) finish_tooth();
      stage_ = 3;
    } else if (stage_ == 3) {
      stage_ = 0;
      return decide();
    } else if (stage_ == kForget) {
      stage_ = 0;
      empty();
    }
    return false;
  }
  MonitorState judge(SignalState signal) noexcept {
    State& s = memory_.state;
    s.signal = signal;
    return combine(memory_.fresh.process(s.value, signal),
                   signal == SignalState::good ? memory_.lasting.state().state
                                               : memory_.lasting.process(Real(0), signal));
  }
  [[nodiscard]] const State& state() const noexcept { return memory_.state; }
  /// Of its mean over a tooth period, what a tooth has to lose to raise the alarm: what is left out
  /// once comes twice with the next one.
  [[nodiscard]] Real smallest_loss() const noexcept {
    return Real(0.5) * tolerated_news() * memory_.fresh.threshold();
  }
  [[nodiscard]] const AlarmLogic<Real>& alarm() const noexcept { return memory_.fresh; }
  [[nodiscard]] const AlarmLogic<Real>& lasting() const noexcept { return memory_.lasting; }
  /// A pattern that is no news lasts; `warning` unless a new one says more.
  [[nodiscard]] bool lasts() const noexcept {
    return memory_.lasting.state().state == MonitorState::alarm;
  }
  [[nodiscard]] const Immersion& immersion() const noexcept { return immersion_; }

 private:
  static constexpr std::uint32_t kForget = 4;  // stage of work()
  static constexpr Real kSteady = Real(0.1);   // growth in a revolution that is no entry
  static constexpr Real kEnding = Real(0.5);   // of the usual mean, below which a cut ends
  static constexpr Real kNews = Real(0.6);     // of what is tolerated, in a pattern that is new
  // What was before a pattern, whose fall comes so long before its rise at most.
  static constexpr std::uint32_t kBefore = kPartsPerTooth * kReach;
  // Noise gives news twice its own deviation, and may grow in power to twice, as chatter does.
  static constexpr double kGrows = 0.5 * 1.4142135623730951;

  MonitorState combine(MonitorState fresh, MonitorState lasting) noexcept {
    if (lasting == MonitorState::alarm) lasting = MonitorState::warning;
    return memory_.state.state = fresh > lasting ? fresh : lasting;
  }

  void empty() noexcept {
    const MonitorState state = memory_.state.state;
    const SignalState signal = memory_.state.signal;
    memory_.state = State{};
    memory_.state.state = state;
    memory_.state.signal = signal;
  }

  void average() noexcept {
    State& s = memory_.state;
    if (s.part == kPartsPerTooth) s.part = 0;
    s.x[s.part] = in_.x;
    s.y[s.part] = in_.y;
    Real x = 0;
    Real y = 0;
    for (unsigned i = 0; i < kPartsPerTooth; ++i) {
      x += s.x[i];
      y += s.y[i];
    }
    constexpr Real kPart = Real(1) / kPartsPerTooth;
    x *= kPart;
    y *= kPart;
    s.level = torque_ ? x : std::sqrt(x * x + y * y);
    s.levels[s.next] = s.level;
    s.next = s.next + 1 == ring_ ? 0 : s.next + 1;
    s.difference = difference(0);
    s.turn_deviation[s.part][s.tooth] = in_.deviation;
    s.turn_x[s.part][s.tooth] = in_.x;
    s.turn_y[s.part][s.tooth] = in_.y;
    ++s.part;
    if (s.parts < learnt()) ++s.parts;
  }

  // Mean course of the signal over a tooth period: what one tooth cuts less the
  // next cuts more.
  void average_teeth() noexcept {
    State& s = memory_.state;
    const std::uint32_t part = s.part - 1;
    Real x = 0;
    Real y = 0;
    Real deviation = 0;
    for (std::uint32_t i = 0; i < teeth_; ++i) {
      x += s.turn_x[part][i];
      y += s.turn_y[part][i];
      deviation += s.turn_deviation[part][i];
    }
    s.profile_x[part] = x * inverse_teeth_;
    s.profile_y[part] = y * inverse_teeth_;
    s.profile_deviation[part] = deviation * inverse_teeth_;
  }

  void finish_tooth() noexcept {
    State& s = memory_.state;
    s.tooth = s.tooth + 1 == teeth_ ? 0 : s.tooth + 1;
    Real x = 0;
    Real y = 0;
    Real power = 0;
    Real within = 0;
    for (unsigned i = 0; i < kPartsPerTooth; ++i) {
      x += s.profile_x[i];
      y += s.profile_y[i];
      power += s.profile_x[i] * s.profile_x[i] + s.profile_y[i] * s.profile_y[i];
      within += s.profile_deviation[i] * s.profile_deviation[i];
    }
    within -= sample_noise_;
    if (within > 0) power += within;
    s.shape = power > 0 ? (x * x + y * y) / (power * Real(kPartsPerTooth)) : Real(0);
    Real told = in_.swept_rad;
    if (!(told > 0)) told = told_;
    const auto found = told > 0 ? immersion_.from_angle(told) : immersion_.from_shape(s.shape);
    s.swept_rad = found.swept_rad;
    s.threshold = found.threshold;
  }

  // D and Delta so many parts ago, 0 = now.
  [[nodiscard]] Real level(std::uint32_t ago) const noexcept {
    const std::uint32_t at = memory_.state.next + ring_ - 1 - ago;
    return memory_.state.levels[at < ring_ ? at : at - ring_];
  }
  [[nodiscard]] Real difference(std::uint32_t ago) const noexcept {
    return level(ago) - level(ago + kPartsPerTooth);
  }

  // Mean of D over this revolution and the one before, from the periods that
  // end now.
  void compare_turns() noexcept {
    State& s = memory_.state;
    Real now = 0;
    Real before = 0;
    for (std::uint32_t i = 0; i < teeth_; ++i) {
      now += level(i * kPartsPerTooth);
      before += level((i + teeth_) * kPartsPerTooth);
    }
    now = magnitude(now) * inverse_teeth_;
    before = magnitude(before) * inverse_teeth_;
    const Real growth = now - before - kSteady * now;
    s.growth = growth > 0 ? growth : Real(0);
    s.mean = now;
    s.forgotten = least(forget_per_sample_ * static_cast<Real>(in_.samples), forget_most_);
    s.usual = most(now, s.usual - s.forgotten * s.usual);
  }

  bool decide() noexcept {
    State& s = memory_.state;
    if (s.parts < learnt()) {
      judge(SignalState::filling);
      return false;
    }
    const std::uint32_t turn = teeth_ * kPartsPerTooth;
    const Real rise = s.difference;
    Real size = 0;
    Real fresh = 0;
    Real fall = 0;
    if (rise > 0) {
      const Real new_rise = rise - difference(turn);
      for (std::uint32_t k = 1; k <= kReach; ++k) {
        const Real now = difference(k * kPartsPerTooth);
        const Real was = difference(k * kPartsPerTooth + turn);
        const Real any = least(Real(-2) * now, rise);
        const Real changed = least(Real(-2) * (now - was), new_rise) * inverse_fraction_;
        if (any > size) size = any;
        if (least(any, changed) > fresh) fresh = least(any, changed);
        if (-now > fall) fall = -now;
      }
    }
    // What goes on changing, as chatter does, has changed before the pattern began, too.
    const Real news = difference(kBefore) - difference(kBefore + turn);
    s.restless += inverse_turn_ * (news * news - s.restless);
    s.ratio = s.mean > 0 ? size / s.mean : Real(0);
    // When the feed stops, or the cut ends, run-out is what cuts last: forget
    // slowly.
    s.tolerated = most(s.threshold * s.mean, s.tolerated - s.forgotten * s.tolerated);
    // Run-out and noise add up; noise alone must be beyond doubt.
    const Real tolerated = most(s.tolerated + Real(0.5) * floor_, floor_);
    fresh -= s.growth * static_cast<Real>(teeth_);
    // What a lone tooth leaves is twice the mean at most: from less, no pattern
    // can count.
    if (s.mean < kEnding * s.usual || s.usual < Real(0.5) * floor_) fresh = 0;
    if (in_.matching) {
      s.value = least(rise / most(teaching_ * in_.high, floor_),
                      fall / most(-teaching_ * in_.low, floor_));
      if (!(s.value > 0)) s.value = 0;
    } else {
      s.value = fresh > 0 ? fresh / tolerated_news() : Real(0);
    }
    if (size > s.most * tolerated) s.most = size / tolerated;
    if (++s.turn >= turn) {
      memory_.lasting.process(in_.matching ? Real(0) : s.most, SignalState::good);
      s.turn = 0;
      s.most = 0;
    }
    const MonitorState before = s.state;
    return judge(SignalState::good) == MonitorState::alarm && before != MonitorState::alarm;
  }

  // Run-out is no news, so what is new need not be held against all of it, but against what is new
  // in every revolution.
  [[nodiscard]] Real tolerated_news() const noexcept {
    const State& s = memory_.state;
    return most(kNews * s.tolerated + floor_, restless_ * std::sqrt(s.restless));
  }
  // A full ring of tooth periods, the first of which takes kPartsPerTooth parts
  // to come.
  [[nodiscard]] std::uint32_t learnt() const noexcept { return ring_ + kPartsPerTooth; }
  static Real least(Real a, Real b) noexcept { return a < b ? a : b; }
  static Real most(Real a, Real b) noexcept { return a > b ? a : b; }
  static Real magnitude(Real a) noexcept { return a < 0 ? -a : a; }

  Immersion immersion_;
  Memory memory_;
  Input in_;
  Real sample_noise_ = 0;
  Real floor_ = 0;
  Real told_ = 0;
  Real inverse_fraction_ = 2;
  Real inverse_teeth_ = 1;
  Real inverse_turn_ = 1;
  Real restless_ = 0;
  Real forget_per_sample_ = 0;
  Real forget_most_ = 0;
  Real teaching_ = 1;
  std::uint32_t teeth_ = 2;
  std::uint32_t ring_ = 1;
  std::uint32_t stage_ = 0;
  bool torque_ = false;
};

}  // namespace servosense
