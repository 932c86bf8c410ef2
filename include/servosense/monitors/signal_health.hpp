// Signal health: can the other monitors trust what this drive reports?
//
// Purpose: says which fault a drive's signals have, how often, and when they are fit again. The
// conditioning (core/drive_input.hpp) flags and repairs single samples; this monitor judges them
// over time, and sees what no single sample shows.
//   cause            sign                                                       state
//   silent-bus       dead_bus: nothing arrives                                  signal-fault
//   stuck-encoder    repeats its reading to the bit where no mass can stop      signal-fault
//   stale-effort     no new effort for four updates while the drive moves       signal-fault
//   gap              a fault longer than what is bridged                        signal-fault
//   jump             a reading beside its track, a spike of the effort, a       warning; beyond
//                    counter narrower than stated                               what is bridged:
//                                                                               gap
//   damaged          NaN, Inf, marked invalid                                   warning
//   disorder         duplicate, reordered or missing samples                    warning
//   jitter           samples that come late                                     warning
//   saturated        effort at its limit for saturated_samples                  warning
//   frozen-effort    the same effort for frozen_samples while the drive moves   warning
//   zeros            nothing but zeros since the start (power-up)               learning
//   too-many         share of faulty samples above tolerated_share              signal-fault
// A drive that stands still may repeat its values for ever. The share is an exponential mean over
// window_samples:  share += (faulty - share) / window_samples, 0 once below 1e-6 and armed.
// Delay: none for single samples, else the stated numbers of samples; a state ends release_samples
// after its last cause.
// Cost on Cortex-M4F: see bench/firmware/instructions.csv.
// Range: any.
// Numerical bound: no sums; nothing drifts, nothing latches.
// Bad at: an encoder that sticks at standstill (indistinguishable from standing), a current that is
// wrong but alive.
#pragma once

#include <cstdint>

#include "servosense/core/drive_sample.hpp"
#include "servosense/core/quality.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"
#include "servosense/monitors/monitor.hpp"

namespace servosense {

struct SignalHealthConfig {
  bool enabled = true;              ///< else the monitor idles
  double effort_limit = 0;          ///< Nm or N the drive can give; 0: not known
  unsigned saturated_samples = 80;  ///< in a row at 99 % of the limit or beyond
  unsigned frozen_samples = 1600;   ///< new efforts in a row, all equal, in motion; 0: off
  double tolerated_share = 0.01;    ///< of faulty samples, 0..1
  unsigned window_samples = 8000;   ///< over which the share is taken
  unsigned release_samples = 8000;  ///< without a fault before a state ends
};

enum class SignalCause : std::uint8_t {
  none,
  zeros,
  jitter,
  saturated,
  frozen_effort,
  disorder,
  damaged,
  jump,
  too_many,
  gap,
  stale_effort,
  stuck_encoder,
  silent_bus,
};

[[nodiscard]] constexpr const char* name_of(SignalCause cause) noexcept {
  constexpr const char* kNames[] = {
      "none", "zeros",    "jitter", "saturated",    "frozen-effort", "disorder",  "damaged",
      "jump", "too-many", "gap",    "stale-effort", "stuck-encoder", "silent-bus"};
  return kNames[static_cast<std::uint8_t>(cause)];
}

template <RealNumber Real>
class SignalHealthMonitor {
 public:
  using Config = SignalHealthConfig;
  struct State {
    MonitorState state = MonitorState::learning;
    SignalCause cause = SignalCause::zeros;  ///< the gravest since the state began
    Real share = 0;                          ///< of faulty samples, 0..1
    std::uint32_t quiet = 0;                 ///< samples since the last cause
    std::uint32_t sound = 0;                 ///< samples since the last faulty one, up to a limit
    std::uint64_t faults = 0;                ///< faulty samples since the start
    Real last_effort = 0;
    std::uint32_t equal_efforts = 0;
    std::uint32_t at_limit = 0;
    bool alive = false;  ///< something other than zero has been seen
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.effort_limit >= 0 && is_finite(c.effort_limit)))
      return Status::invalid("effort_limit", "must be zero (not known) or a positive number");
    if (c.saturated_samples < 1) return Status::invalid("saturated_samples", "must be at least 1");
    if (!(c.tolerated_share > 0 && c.tolerated_share <= 1))
      return Status::invalid("tolerated_share", "must be within 0 and 1");
    if (c.window_samples < 1) return Status::invalid("window_samples", "must be at least 1");
    if (c.release_samples < 1) return Status::invalid("release_samples", "must be at least 1");
    return {};
  }

  /// Requires validate(c).ok().
  void configure(const Config& c) noexcept {
    limit_ = static_cast<Real>(c.effort_limit > 0 ? 0.99 * c.effort_limit : 0);
    saturated_ = c.saturated_samples;
    frozen_ = c.frozen_samples > 0 ? c.frozen_samples : ~std::uint32_t{0};
    tolerated_ = static_cast<Real>(c.tolerated_share);
    forget_ = static_cast<Real>(1.0 / c.window_samples);
    release_ = c.release_samples;
    recurs_ = static_cast<std::uint32_t>(3 / c.tolerated_share);
    enabled_ = c.enabled;
    reset();
  }
  void reset() noexcept {
    state_ = State{};
    everyday_ = calm_ = distrusted_ = false;
    if (!enabled_) state_.state = MonitorState::idle;
  }

  /// One sample, as the conditioning of the drive gives it.
  MonitorState process(const DriveSample<Real>& in) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    // A live drive whose sample is sound and new: almost every one. judge() gives the same.
    if (in.quality == Quality::good && everyday_ && in.effort != s.last_effort) {
      s.last_effort = in.effort;
      return calm_ ? MonitorState::armed : calm_down();
    }
    return judge(in);
  }

  [[nodiscard]] const State& state() const noexcept { return state_; }
  /// Faults come back, and are too many: what is repaired is no base for a verdict.
  [[nodiscard]] bool distrusted() const noexcept { return distrusted_; }
  [[nodiscard]] Real threshold() const noexcept { return tolerated_; }

 private:
  // A sound sample after some that were not.
  MonitorState calm_down() noexcept {
    State& s = state_;
    s.share -= s.share * forget_;
    s.equal_efforts = 0;
    if (distrusted_) {
      ++s.sound;
      distrusted_ = recur();
    }
    if (s.state != MonitorState::armed) {
      if (++s.quiet >= release_) recover();
    } else if (s.share < kNone) {
      s.share = 0;
      calm_ = true;
    }
    return s.state;
  }

  [[gnu::noinline]] MonitorState judge(const DriveSample<Real>& in) noexcept {
    State& s = state_;
    if (!enabled_) return s.state;
    const bool held = has(in.quality, Quality::held);
    SignalCause cause = cause_of(in.quality);
    const bool faulty = has(in.quality, kUnusable | Quality::gap);
    s.faults += faulty ? 1 : 0;
    s.share += ((faulty ? Real(1) : Real(0)) - s.share) * forget_;
    if (!held && !faulty) cause = max(cause, cause_of_effort(in));
    if (faulty && s.share > tolerated_) cause = max(cause, SignalCause::too_many);
    calm_ = calm_ && cause == SignalCause::none && s.equal_efforts == 0;
    if (!s.alive) {
      s.alive = !faulty &&
                (in.increment != 0 || (in.effort != 0 && is_finite(in.effort)) || in.position != 0);
      if (!s.alive && !faulty) {
        s.cause = SignalCause::zeros;
        return s.state = MonitorState::learning;
      }
      everyday_ = s.alive && limit_ == 0;
    }
    s.sound = faulty ? 0 : s.sound + (s.sound < recurs_ ? 1 : 0);
    distrusted_ = recur();
    if (cause == SignalCause::none) {
      const bool sick = s.state == MonitorState::warning || s.state == MonitorState::signal_fault;
      if (!sick || ++s.quiet >= release_) recover();
      return s.state;
    }
    s.quiet = 0;
    if (cause > s.cause || s.cause == SignalCause::zeros) s.cause = cause;
    const bool grave = cause >= SignalCause::too_many;
    if (grave)
      s.state = MonitorState::signal_fault;
    else if (s.state != MonitorState::signal_fault)
      s.state = MonitorState::warning;
    return s.state;
  }

  // One in `tolerated_share` comes so often that three times that without one is the end of it.
  [[nodiscard]] bool recur() const noexcept {
    return state_.share > tolerated_ && state_.sound < recurs_;
  }

  void recover() noexcept {
    state_.state = MonitorState::armed;
    state_.cause = SignalCause::none;
  }

  static SignalCause max(SignalCause a, SignalCause b) noexcept { return a > b ? a : b; }

  static SignalCause cause_of(Quality q) noexcept {
    if (has(q, Quality::dead_bus)) return SignalCause::silent_bus;
    if (has(q, Quality::stuck)) return SignalCause::stuck_encoder;
    if (has(q, Quality::stale)) return SignalCause::stale_effort;
    if (has(q, Quality::gap)) return SignalCause::gap;
    if (has(q, Quality::jump)) return SignalCause::jump;
    if (has(q, Quality::duplicate | Quality::reordered | Quality::missing))
      return SignalCause::disorder;
    if (has(q, Quality::late)) return SignalCause::jitter;
    if (has(q, Quality::invalid)) return SignalCause::damaged;
    if (has(q, Quality::saturated)) return SignalCause::saturated;
    return SignalCause::none;
  }

  SignalCause cause_of_effort(const DriveSample<Real>& in) noexcept {
    State& s = state_;
    const bool full = limit_ > 0 && (in.effort >= limit_ || in.effort <= -limit_);
    s.at_limit = full ? s.at_limit + (s.at_limit < saturated_ ? 1 : 0) : 0;
    const bool equal = in.effort == s.last_effort && in.increment != 0;
    s.last_effort = in.effort;
    s.equal_efforts = equal ? s.equal_efforts + (s.equal_efforts < frozen_ ? 1 : 0) : 0;
    if (s.equal_efforts >= frozen_) return SignalCause::frozen_effort;
    if (s.at_limit >= saturated_) return SignalCause::saturated;
    return SignalCause::none;
  }

  static constexpr Real kNone = Real(1e-6);  // share below which there was no fault

  State state_;
  Real limit_ = 0;
  Real tolerated_ = 0;
  Real forget_ = 0;
  std::uint32_t saturated_ = 0;
  std::uint32_t frozen_ = 0;
  std::uint32_t release_ = 0;
  std::uint32_t recurs_ = 0;
  bool distrusted_ = false;
  bool enabled_ = true;
  bool everyday_ = false;  // alive, and no limit to watch
  bool calm_ = false;      // besides, armed, and nothing left of any fault
};

}  // namespace servosense
