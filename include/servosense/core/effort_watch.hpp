// Is an effort one that the drive gave, and is it still told of it?
//
// Purpose: what single values do not show of a stream of motor currents.
//   stale     no new value for longer than the drive takes between two, while it moves
//   spike     a value that the next one takes back
// Stale, where a source tells that nothing has come: four updates are missing, of the stated rate
// or of the mean, 8 samples at least; from then on until eight have come in time. Where it repeats
// the last value: no change for 4 (m + 8 d) samples, or four updates of the stated rate, while the
// drive moves; m is the mean and d the mean deviation of the samples between two changes. Of values
// that repeat by chance one run in 1e11 is as long. Ideal ones may repeat for ever: it holds of
// those that have shown noise, changes that turn round more often than every fourth time (white:
// two of three).
// Spike: the largest change lately (it fades by 1/e in half a second) is the measure u. A step
// beyond 3 u is doubtful: of white noise, whose changes go to 2.2 of their sigma and more in half a
// second, one in 1e10. It is a spike if the next value is back within u
// and an eighth of the step, and sound if that is not, or if none comes in the time of two. Zero is
// what a drive gives that has nothing to tell: a step to zero that repeats stays doubtful until it
// is stale.
// Delay: none, but one new value for a step beyond 3 u.
// Cost on Cortex-M4F: within that of the drive input.
// Numerical bound: no sums; nothing drifts.
// Bad at: a current that is wrong but alive, for longer than a value: a step that stays is what a
// contact makes, too. That the mass does not answer it does not tell the two apart where the
// controller is stiff and the encoder coarse. Steps below 3 u.
#pragma once

#include <cmath>
#include <cstdint>

#include "servosense/core/real_time.hpp"
#include "servosense/core/whole.hpp"

namespace servosense {

struct EffortWatchConfig {
  bool on = false;  ///< else everything is sound
  double sample_period_s = 125e-6;
  double update_s = 0;  ///< between two values, as stated; 0: as they come
  unsigned least = 8;   ///< samples without a new value that are no fault
};

enum class EffortFinding : std::uint8_t { sound, doubtful, spike, stale };

template <RealNumber Real>
class EffortWatch {
 public:
  using Config = EffortWatchConfig;

  void configure(const Config& c) noexcept {
    on_ = c.on;
    stated_ = static_cast<Real>(c.update_s / c.sample_period_s);
    least_ = c.least < 1 ? 1 : c.least;
    shortest_ = samples(0.001 / c.sample_period_s);
    // Never heard: as for the slowest currents, of 100 Hz.
    first_ = samples(2 * (c.update_s > 0 ? c.update_s : 0.01) / c.sample_period_s);
    reset();
  }
  void reset() noexcept {
    usual_ = on_ ? Real(0) : kAny;
    last_change_ = deviation_ = noise_ = 0;
    mean_ = stated_;
    notes_ = run_ = doubt_ = held_ = probation_ = 0;
    travel_ = 0;
    noisy_ = heard_ = measured_ = false;
    even_ = 0;
    arrival_ = stated_;
    limit_ = kNever;
    silence_ = on_ ? first_ : kNever;
  }

  /// Whether a sample that changed the effort by so much needs no look.
  [[gnu::always_inline]] bool everyday(Real change) const noexcept {
    if (change != 0) return std::abs(change) <= usual_;
    return run_ + 1 < limit_ && held_ + 1 < silence_;
  }
  /// Such a sample; `step`: counts moved.
  [[gnu::always_inline]] void take(Real change, bool fresh, std::int32_t step) noexcept {
    if (change != 0) {
      if (run_ != 0) renewed(change);
      last_change_ = change;
    } else {
      ++run_;
      travel_ += static_cast<std::uint32_t>(step);
      if (!fresh) {
        ++held_;
        return;
      }
    }
    if (held_ != 0) arrived();
  }

  /// Any sample: the new effort, the last one, whether it is `fresh` (not held), the first for long
  /// (`anew`), and the motion in counts.
  [[gnu::noinline]] EffortFinding hear(Real effort, Real last, bool fresh, bool anew,
                                       std::int32_t step) noexcept {
    if (!on_) return EffortFinding::sound;
    const EffortFinding heard = listen(fresh);
    if (heard != EffortFinding::sound) return heard;
    if (doubt_ > 0) return resolve(effort, fresh);
    const Real change = fresh ? effort - last : Real(0);
    if (anew && fresh && (change != 0 || run_ < too_long(limit_))) return accept();
    if (change == 0) {
      if (run_ < too_long(limit_)) {
        ++run_;
        travel_ += static_cast<std::uint32_t>(step);
      }
      if (run_ < limit_) return EffortFinding::sound;
      if (travel_ + kStands > 2 * kStands)
        return run_ < too_long(limit_) ? EffortFinding::doubtful : EffortFinding::stale;
      run_ = 0;
      travel_ = 0;
      return EffortFinding::sound;
    }
    if (run_ >= too_long(limit_)) return accept();
    const Real size = magnitude(change);
    if (notes_ == kKnown && size > kBeyond * usual_) {
      before_ = last;
      doubted_ = effort;
      run_ = 0;
      travel_ = 0;
      doubt_ = 1;
      const auto two = static_cast<std::uint32_t>(2 * mean_) + 1;
      deadline_ = two > shortest_ ? two : shortest_;
      return EffortFinding::doubtful;
    }
    if (size > usual_) usual_ = size;
    take(change, fresh, step);
    return EffortFinding::sound;
  }

  /// Now and then: the effort, and its change with this sample.
  [[gnu::noinline]] void learn(Real effort, Real change) noexcept {
    if (!on_) return;
    usual_ -= usual_ * Real(1.0 / 64);
    measured_ = usual_ > kRounding * magnitude(effort);
    if (!is_moderate(change) || change == 0) return;
    if (run_ == 0 && last_change_ != 0) note(change, 1);
  }

  [[nodiscard]] bool doubts() const noexcept { return doubt_ > 0; }

 private:
  static constexpr std::uint32_t kStands = 4;  // counts that a drive may be pushed about
  static constexpr std::uint32_t kKnown = 32;  // changes that noise is known from
  static constexpr std::uint32_t kNever = 0x7fffffffU;
  static constexpr std::uint32_t kEven = 64;
  static constexpr std::uint32_t kProbation = 8;  // 90 % lost, one time in 1e6
  static constexpr Real kBeyond = 3;              // times what is usual
  static constexpr Real kAny = Real(1e18);        // its square is a number in float
  static constexpr Real kRounding = Real(1e-6);   // no converter has 20 bits
  static constexpr Real kForget = Real(1.0 / 64);

  static Real magnitude(Real x) noexcept { return x < 0 ? -x : x; }
  static std::uint32_t samples(double n) noexcept {
    return n < 2 ? 2 : n > 1e9 ? 1000000000U : nearest_whole(n);
  }

  EffortFinding accept() noexcept {
    run_ = doubt_ = 0;
    travel_ = 0;
    last_change_ = 0;
    return EffortFinding::sound;
  }

  [[gnu::noinline]] void renewed(Real change) noexcept {
    const std::uint32_t period = run_ + 1;
    if (on_ && run_ < too_long(limit_) && last_change_ != 0)
      note(change, static_cast<Real>(period));
    run_ = 0;
    travel_ = 0;
  }

  void note(Real change, Real period) noexcept {
    const Real turned = (change < 0) != (last_change_ < 0) ? Real(1) : Real(0);
    noise_ += (turned - noise_) * kForget;
    if (notes_ == 0 && mean_ == 0) mean_ = period;
    const Real off = period - mean_;
    mean_ += off * kForget;
    deviation_ += (magnitude(off) - deviation_) * kForget;
    if (notes_ < kKnown) ++notes_;
    noisy_ = noisy_ || (measured_ && notes_ == kKnown && noise_ > Real(0.25));
    set_limit();
  }
  void set_limit() noexcept {
    if (!noisy_) return;
    const Real run = mean_ + 8 * deviation_;
    limit_ = long_of(run > 2 * mean_ ? run : 2 * mean_);
  }
  // Two of these, or of the updates that are stated: from then on the value is doubtful.
  [[nodiscard]] std::uint32_t long_of(Real period) const noexcept {
    const Real most = 2 * (period > stated_ ? period : stated_);
    return most > 2 ? static_cast<std::uint32_t>(most) : 2;
  }
  // And from then on stale.
  [[nodiscard]] std::uint32_t too_long(std::uint32_t doubtful) const noexcept {
    return 2 * doubtful > least_ ? 2 * doubtful : least_;
  }

  [[gnu::noinline]] void arrived() noexcept {
    const auto period = static_cast<Real>(held_ + 1);
    held_ = 0;
    if (!on_) return;
    if (arrival_ == 0) arrival_ = period;
    arrival_ += (period - arrival_) * kForget;
    silence_ = long_of(arrival_);
  }
  // Nothing has come for too long, or comes by fits and starts since.
  EffortFinding listen(bool fresh) noexcept {
    if (!fresh) {
      if (++held_ >= too_long(silence_)) probation_ = kProbation, even_ = 0;
      if (probation_ > 0) return EffortFinding::stale;
      return held_ >= silence_ && silence_ < first_ ? EffortFinding::doubtful
                                                    : EffortFinding::sound;
    }
    const auto period = static_cast<Real>(held_ + 1);
    if (probation_ == 0) {
      if (arrival_ == 0 && heard_) arrival_ = period, silence_ = long_of(period);
      if (held_ != 0) arrived();
      heard_ = true;
      return EffortFinding::sound;
    }
    held_ = 0;
    probation_ = period <= 2 * arrival_ ? probation_ - 1 : kProbation;
    // A pace of its own, for as long as chance would not keep it.
    const bool even = period <= 2 * last_period_ && last_period_ <= 2 * period;
    last_period_ = period;
    even_ = even ? even_ + 1 : 0;
    if (even_ == kEven || !heard_) {
      probation_ = 0;
      arrival_ = heard_ ? period : Real(0);
      silence_ = heard_ ? long_of(period) : first_;
      heard_ = true;
    }
    return probation_ > 0 ? EffortFinding::stale : EffortFinding::sound;
  }

  EffortFinding resolve(Real effort, bool fresh) noexcept {
    const Real jump = doubted_ - before_;
    if (fresh && effort != doubted_) {
      if (magnitude(effort - before_) > usual_ + Real(0.125) * magnitude(jump))
        return believe(jump);
      accept();
      return EffortFinding::spike;
    }
    if (++doubt_ <= deadline_) return EffortFinding::doubtful;
    if (!(doubted_ == 0 && noisy_)) return believe(jump);
    return doubt_ <= too_long(limit_) ? EffortFinding::doubtful : EffortFinding::stale;
  }
  EffortFinding believe(Real jump) noexcept {
    const Real size = magnitude(jump);
    if (size > usual_) usual_ = size;
    return accept();
  }

  Real usual_ = 0;         // largest change lately
  std::uint32_t run_ = 0;  // samples since the last new value
  std::uint32_t limit_ = kNever;
  Real last_change_ = 0;
  std::uint32_t travel_ = 0;  // counts since the last new value, modulo 2^32
  bool noisy_ = false;
  bool measured_ = false;  // its changes are more than the rounding of arithmetic
  Real mean_ = 0;          // samples between two new values...
  Real deviation_ = 0;
  Real noise_ = 0;  // part of the changes that turn round
  std::uint32_t notes_ = 0;
  // Of what comes with marks where nothing new has come.
  std::uint32_t held_ = 0;  // samples since a value came
  std::uint32_t silence_ = kNever;
  std::uint32_t probation_ = 0;  // values to come in time before any is believed
  std::uint32_t even_ = 0;       // that came as long after one another as those before, or double
  bool heard_ = false;
  Real arrival_ = 0;      // samples between two values
  Real last_period_ = 0;  // between the last two, while on probation
  // Of a doubtful step.
  std::uint32_t doubt_ = 0;  // samples since it came
  std::uint32_t deadline_ = 0;
  Real before_ = 0, doubted_ = 0;
  // From the configuration.
  bool on_ = false;
  Real stated_ = 0;  // samples a value, 0: not known
  std::uint32_t least_ = 8, first_ = 0, shortest_ = 0;
};

}  // namespace servosense
