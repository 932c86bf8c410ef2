// What all monitors have in common: how a value becomes an alarm. Who they are and what they say:
// core/monitor_id.hpp, core/monitor_state.hpp.
#pragma once

#include <cmath>
#include <cstdint>

#include "servosense/core/monitor_id.hpp"
#include "servosense/core/monitor_state.hpp"
#include "servosense/core/real_time.hpp"
#include "servosense/core/status.hpp"

namespace servosense {

/// What the caller knows about this sample. `doubtful`: nothing follows from it, this way or that.
enum class SignalState : std::uint8_t { good, filling, standstill, faulty, doubtful };

struct AlarmLogicConfig {
  double threshold = 0;  ///< alarm level, in the monitor's unit; 0 = not set, monitor idles
  double warning_fraction = 0.75;    ///< warning level as a fraction of the threshold
  double release_fraction = 0.5;     ///< an alarm or warning ends below this fraction...
  unsigned release_samples = 800;    ///< ...held for so many samples
  unsigned consecutive_samples = 3;  ///< samples in a row at or above a level that raise it
  /// An alarm or warning outlasts so many samples that say nothing of it: of a fault, and of
  /// filters that fill again. What goes on behind them is the same episode.
  unsigned patience_samples = 8000;
};

/// Two levels with a consecutive-sample rule and hysteresis. An alarm is over once the value has
/// stayed below the release level; nothing latches. A value that is NaN is a faulty signal.
template <RealNumber Real>
class AlarmLogic {
 public:
  using Config = AlarmLogicConfig;
  struct State {
    MonitorState state = MonitorState::idle;
    Real value = 0;
    std::uint32_t over_alarm = 0;    // samples in a row at or above the threshold
    std::uint32_t over_warning = 0;  // samples in a row at or above the warning level
    std::uint32_t below_release = 0;
    std::uint32_t away = 0;  // samples in a row that say nothing
  };

  static Status validate(const Config& c) noexcept {
    if (!(c.threshold >= 0 && is_finite(c.threshold)))
      return Status::invalid("threshold", "must be zero (off) or a positive number");
    if (!(c.warning_fraction > 0 && c.warning_fraction <= 1))
      return Status::invalid("warning_fraction", "must be within 0 and 1");
    if (!(c.release_fraction > 0 && c.release_fraction <= c.warning_fraction))
      return Status::invalid("release_fraction", "must be within 0 and warning_fraction");
    if (c.release_samples < 1) return Status::invalid("release_samples", "must be at least 1");
    if (c.consecutive_samples < 1)
      return Status::invalid("consecutive_samples", "must be at least 1");
    return {};
  }
  void configure(const Config& c) noexcept {
    threshold_ = static_cast<Real>(c.threshold);
    warning_ = static_cast<Real>(c.threshold * c.warning_fraction);
    release_ = static_cast<Real>(c.threshold * c.release_fraction);
    release_samples_ = c.release_samples;
    consecutive_ = c.consecutive_samples;
    patience_ = c.patience_samples;
    reset();
  }
  void reset() noexcept { state_ = State{}; }
  /// The samples in a row begin anew: one of them was none.
  void interrupt() noexcept { state_.over_alarm = state_.over_warning = 0; }

  MonitorState process(Real value, SignalState signal) SERVOSENSE_NONBLOCKING {
    State& s = state_;
    s.value = value;
    // Armed and nothing near: almost every sample.
    if (signal == SignalState::good && s.state == MonitorState::armed &&
        std::abs(value) < release_) {
      s.over_alarm = s.over_warning = 0;
      return s.state;
    }
    return process_in_full(value, signal);
  }

  [[nodiscard]] Real threshold() const noexcept { return threshold_; }
  [[nodiscard]] const State& state() const noexcept { return state_; }

 private:
  [[gnu::noinline]] MonitorState process_in_full(Real value, SignalState signal) noexcept {
    State& s = state_;
    if (signal == SignalState::standstill || !(threshold_ > 0))
      return stand_down(MonitorState::idle);
    if (signal == SignalState::doubtful) return s.state;
    const bool faulty = signal == SignalState::faulty || !is_finite(value);
    if (faulty || signal == SignalState::filling) {
      const bool raised = s.state == MonitorState::alarm || s.state == MonitorState::warning;
      s.over_alarm = s.over_warning = s.below_release = 0;
      if (raised && ++s.away <= patience_) return s.state;
      return stand_down(faulty ? MonitorState::signal_fault : MonitorState::learning);
    }
    s.away = 0;
    if (s.state != MonitorState::warning && s.state != MonitorState::alarm)
      s.state = MonitorState::armed;
    s.over_alarm = value >= threshold_ ? s.over_alarm + (s.over_alarm < consecutive_) : 0;
    s.over_warning = value >= warning_ ? s.over_warning + (s.over_warning < consecutive_) : 0;
    s.below_release = value < release_ ? s.below_release + (s.below_release < release_samples_) : 0;
    if (s.over_alarm >= consecutive_) {
      s.state = MonitorState::alarm;
    } else if (s.over_warning >= consecutive_ && s.state == MonitorState::armed) {
      s.state = MonitorState::warning;
    } else if (s.below_release >= release_samples_) {
      s.state = MonitorState::armed;
    }
    return s.state;
  }

  MonitorState stand_down(MonitorState to) noexcept {
    state_.over_alarm = state_.over_warning = state_.below_release = state_.away = 0;
    return state_.state = to;
  }

  State state_;
  Real threshold_ = 0;
  Real warning_ = 0;
  Real release_ = 0;
  std::uint32_t release_samples_ = 0;
  std::uint32_t consecutive_ = 1;
  std::uint32_t patience_ = 0;
};

}  // namespace servosense
