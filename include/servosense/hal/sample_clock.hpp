// Clock recovery: which tick of a regular sender a time stamp belongs to.
//
// Purpose: a sender's events come at its own fixed rate, their stamps early or late by what the way
// costs. Steps between stamps that are rounded one by one lose or invent a tick whenever two delays
// differ by half a period; so the phase is accumulated, and every stamp is compared with it.
// Equation: a phase-locked loop of second order (alpha-beta filter, Kalata 1984):
//   e = (t - phase) / period - n        ticks by which tick n, counted from the last, is late
//   phase += (n + g e) period,  g = alpha, or 1/k for the k-th tick after the start if that is more
//   period += beta e period,    within 1 % of the nominal one
// with alpha apart for early and late events; where e is more than half a tick (a stall), it is
// taken for 1/16. A constant error d of the rate leaves e = d (1 - alpha) / alpha, and none with
// beta > 0 (alpha^2 / (2 - alpha) is Benedict and Bordner's, 1962). What does not fit (no tick has
// passed, or more than `longest`) is left out, until it has come kBelieved times in a row: then the
// clock of the stamps has jumped, and is begun anew. Lock: the mean of |e| tells the usual jitter.
// An event further off than four times that (1/16 of a tick at least, 3/8 at most) may be of
// another tick, or the rate another one: until kLock events in a row have come on time, which tick
// they are is not known. Where the mean is above 1/16, nor is it behind a tick that is missing or
// too many. Cost: O(1), no memory. Range: any stamps; arithmetic saturates. Bad at: jitter beyond
// 3/8 of a tick, which never locks; a loss of one tick and a step of the stamps' clock by one,
// which look alike.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "servosense/core/units.hpp"

namespace servosense {

/// Sums and products of times that stay within the range of Nanoseconds.
[[nodiscard]] inline Nanoseconds saturated_sum(Nanoseconds a, Nanoseconds b) noexcept {
  Nanoseconds sum = 0;
  if (!__builtin_add_overflow(a, b, &sum)) return sum;
  return b < 0 ? std::numeric_limits<Nanoseconds>::min() : std::numeric_limits<Nanoseconds>::max();
}
[[nodiscard]] inline Nanoseconds saturated_difference(Nanoseconds a, Nanoseconds b) noexcept {
  Nanoseconds difference = 0;
  if (!__builtin_sub_overflow(a, b, &difference)) return difference;
  return a < b ? std::numeric_limits<Nanoseconds>::min() : std::numeric_limits<Nanoseconds>::max();
}
[[nodiscard]] inline Nanoseconds saturated_product(Nanoseconds a, Nanoseconds b) noexcept {
  Nanoseconds product = 0;
  if (!__builtin_mul_overflow(a, b, &product)) return product;
  return (a < 0) != (b < 0) ? std::numeric_limits<Nanoseconds>::min()
                            : std::numeric_limits<Nanoseconds>::max();
}

/// nanoseconds_from() of any number; 0 for NaN.
[[nodiscard]] inline Nanoseconds saturated_from(double seconds) noexcept {
  constexpr double kEnd = 9.2e9;  // 292 years
  return std::isnan(seconds) ? 0 : nanoseconds_from(std::clamp(seconds, -kEnd, kEnd));
}

struct SampleClockConfig {
  double period_ns = 125000;                  ///< from tick to tick, positive
  double early_gain = 1.0 / 64;               ///< alpha
  double late_gain = 1.0 / 64;                ///< alpha
  double rate_gain = 1.0 / 8128;              ///< beta; 0: the period is known
  double longest = kMostTicks;                ///< ticks: more are not believed at once
  static constexpr double kMostTicks = 1e12;  ///< 4 years at 8 kHz
};

class SampleClock {
 public:
  /// Events in a row that do not fit, until they are believed: one or two are stray frames.
  static constexpr unsigned kBelieved = 4;
  /// Events on time in a row, until it is known again which tick they are. At a wrong rate more
  /// than 1 % off (which the loop does not follow) a tick slips before that.
  static constexpr unsigned kLock = 32;

  explicit SampleClock(const SampleClockConfig& config = {}) noexcept
      : config_(config), period_ns_(config.period_ns) {}

  /// A tick at `t`: all that was known of the phase is forgotten.
  void start(Nanoseconds t) noexcept {
    phase_ns_ = t;
    part_ns_ = 0;
    seen_ = 1;
    refused_ = 0;
    period_ns_ = config_.period_ns;
  }

  /// Ticks since the last one, by the recovered clock: 1 when the next is on time.
  [[nodiscard]] double elapsed(Nanoseconds t) const noexcept {
    return (static_cast<double>(saturated_difference(t, phase_ns_)) - part_ns_) / period_ns_;
  }

  /// The tick `ticks` after the last one came at `t`.
  void follow(std::int64_t ticks, Nanoseconds t) noexcept {
    refused_ = 0;
    if (ticks > kReach) {  // no phase is known over so long
      start(t);
      return;
    }
    const double off = elapsed(t) - static_cast<double>(ticks);
    judge(off, ticks);
    const double e = std::abs(off) > 0.5 ? std::copysign(kCalm, off) : off;
    const double gain = e < 0 ? config_.early_gain : config_.late_gain;
    const double acquiring = 1.0 / static_cast<double>(++seen_);
    part_ns_ += (static_cast<double>(ticks) + std::max(gain, acquiring) * e) * period_ns_;
    if (gain > acquiring)
      period_ns_ = std::clamp(period_ns_ * (1 + config_.rate_gain * e),
                              (1 - kPull) * config_.period_ns, (1 + kPull) * config_.period_ns);
    const double whole = std::floor(part_ns_);
    if (std::abs(whole) > kMostNs) return start(t);
    phase_ns_ = saturated_sum(phase_ns_, static_cast<Nanoseconds>(whole));
    part_ns_ -= whole;
  }

  /// The tick after the last one has come, its stamp tells nothing.
  void pass() noexcept {
    refused_ = 0;
    phase_ns_ = saturated_sum(phase_ns_, static_cast<Nanoseconds>(period_ns_));
    part_ns_ += period_ns_ - std::floor(period_ns_);
  }

  /// Ticks since the last one, told by time alone, and followed; 0: of no new tick, to be left out.
  std::int64_t take(Nanoseconds t) noexcept {
    const double since = elapsed(t);
    const double nearest = std::round(since);
    if (nearest >= 1 && since <= config_.longest) {
      const auto ticks = static_cast<std::int64_t>(nearest);
      follow(ticks, t);
      return ticks;
    }
    if (!refuse(since)) return 0;
    // Stamps that stand still or go back: there are as many ticks as there were events.
    const std::int64_t ticks =
        nearest < 1 ? kBelieved
                    : static_cast<std::int64_t>(std::min(nearest, SampleClockConfig::kMostTicks));
    jump(t);
    return ticks;
  }

  /// An event that fits nowhere; true when there have been enough of them.
  bool refuse(double since) noexcept {
    if (std::abs(since) > limit() || doubtful()) steady_ = 0;  // else the last once more
    return ++refused_ >= kBelieved;
  }
  /// The clock of the stamps has jumped: now it is `t`.
  void jump(Nanoseconds t) noexcept {
    start(t);
    steady_ = 0;
  }

  /// The last event was not the only one of its tick, or not the first to be refused.
  [[nodiscard]] unsigned refused() const noexcept { return refused_; }
  [[nodiscard]] bool locked() const noexcept { return steady_ >= kLock; }
  [[nodiscard]] double period_ns() const noexcept { return period_ns_; }
  /// Ticks by which events are usually off.
  [[nodiscard]] double jitter() const noexcept { return jitter_; }

  /// Back by `ticks`, as one who has heard a stretch already and begins it again.
  void rewind(std::int64_t ticks) noexcept {
    phase_ns_ = saturated_difference(phase_ns_,
                                     saturated_from(static_cast<double>(ticks) * period_ns_ / 1e9));
    steady_ = kLock;
  }

 private:
  static constexpr std::int64_t kReach = 64;  // at 0.2 % between two clocks 1/8 of a tick
  static constexpr double kPull = 0.01;       // quartzes agree far better; the rest is estimation
  static constexpr double kMostNs = 9e18;
  static constexpr double kForget = 1.0 / 64;
  static constexpr double kCalm = 1.0 / 16;

  [[nodiscard]] double limit() const noexcept { return std::clamp(4 * jitter_, kCalm, 3.0 / 8); }
  // In jitter, a tick too many or too few may be none.
  [[nodiscard]] bool doubtful() const noexcept { return jitter_ > kCalm; }
  void judge(double off, std::int64_t ticks) noexcept {
    const bool sure = std::abs(off) <= limit() && (ticks == 1 || !doubtful());
    steady_ = sure ? std::min(steady_ + 1, kLock) : 0;
    jitter_ += kForget * (std::min(std::abs(off), 0.5) - jitter_);
  }

  SampleClockConfig config_;
  Nanoseconds phase_ns_ = 0;  // of the last tick...
  double part_ns_ = 0;        // ...and what is finer
  double period_ns_ = 0;
  double jitter_ = 0;
  std::uint64_t seen_ = 0;  // ticks since the start
  unsigned refused_ = 0;    // events in a row
  unsigned steady_ = kLock;
};

}  // namespace servosense
