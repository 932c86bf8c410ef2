// `servosense monitor --cnc`: a feed hold for alarms.
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "arguments.hpp"
#include "servosense/core/monitor_id.hpp"
#include "servosense/hal/override_request.hpp"
#include "servosense/hal/stop_request.hpp"
#include "servosense/monitors/monitor.hpp"

namespace servosense::cli {

class StopSink {
 public:
  /// Usage error for options that do not go together: a real machine is stopped by a live run
  /// alone.
  static Expected<Done> check(const Arguments& arguments);
  /// Connects to what --cnc says; does nothing without it. `overrides`: the machine file allows
  /// them. Requires check().
  Expected<Done> open(const Arguments& arguments, bool overrides);
  /// The next changes are those of a sample that has arrived now.
  void arrived() noexcept {
    if (request_) arrival_ns_ = link_->now_ns();
  }
  /// With overrides, what they answer (chatter, torque band) is left to them.
  void change(MonitorId monitor, MonitorState state) noexcept {
    if (overrides_ && (monitor == MonitorId::chatter || monitor == MonitorId::torque_band)) return;
    if (request_ && state <= MonitorState::alarm && state >= level_) hold();
  }
  void hold() noexcept {
    if (request_) request_->raise(arrival_ns_);
  }
  /// The feed is held, or is about to be.
  [[nodiscard]] bool active() const noexcept { return request_ && request_->active(); }
  void set(double speed_ratio, double feed_ratio) noexcept {
    if (overrides_) overrides_->set(speed_ratio, feed_ratio);
  }
  /// Feed ratio that the CNC has acknowledged; NaN without overrides.
  [[nodiscard]] double feed_in_effect() const noexcept {
    return overrides_ ? overrides_->feed_in_effect() : std::numeric_limits<double>::quiet_NaN();
  }
  [[nodiscard]] bool taken_over() noexcept { return overrides_ && overrides_->taken_over(); }
  /// Ends it, in good order. What it did; nothing without --cnc.
  std::optional<StopHealth> close();

 private:
  std::unique_ptr<CncLink> link_;
  std::unique_ptr<OverrideRequest> overrides_;
  std::unique_ptr<StopRequest> request_;
  MonitorState level_ = MonitorState::alarm;
  Nanoseconds arrival_ns_ = 0;
};

/// One sentence on what it did.
[[nodiscard]] std::string stop_summary(const StopHealth& health);
/// Some alarm was not followed by a standstill that was seen.
[[nodiscard]] inline bool stop_failed(const StopHealth& health) {
  return health.seen < health.events;
}

}  // namespace servosense::cli
