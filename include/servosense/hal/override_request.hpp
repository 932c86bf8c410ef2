// Overrides of spindle and feed for a CNC, as ratios to what its operator has set.
//
// set() is for the thread that runs the monitors: atomics, no lock, no memory. turn() sends the
// latest, one command or look a call, on the thread that has the link (StopRequest). A control
// takes whole percents; they are rounded towards 1, so that no limit is left.
// An operator who moves an override wins: what the control says differs from what was commanded and
// acknowledged. His setting is the new 1; nothing is sent until 1 has been asked for again.
// Bad at: an operator who moves an override by less than a percent, or within `settle_s` of a
// command; a process that is killed: what was commanded last stays.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>

#include "servosense/hal/cnc_link.hpp"

namespace servosense {

struct OverrideRequestConfig {
  double look_s = 0.1;    ///< between looks at what the control says, and at what is wanted
  double settle_s = 0.3;  ///< from a command until the control must say the same
};

struct OverrideHealth {
  std::uint64_t commands = 0;   ///< acknowledged
  std::uint64_t refused = 0;    ///< or void
  std::uint64_t takeovers = 0;  ///< the operator has moved an override
  double speed = 1, feed = 1;   ///< acknowledged last, ratios to what the operator has set
};

class OverrideRequest {
 public:
  /// The link must outlive the request.
  explicit OverrideRequest(CncLink& link, OverrideRequestConfig config = {});

  /// Wanted from now on; above 0. Never waits.
  void set(double speed_ratio, double feed_ratio) noexcept;
  /// Whether the operator has moved an override since this was asked last.
  [[nodiscard]] bool taken_over() noexcept { return taken_over_.exchange(false); }
  /// Feed ratio that the control has acknowledged last; for the thread that calls set().
  [[nodiscard]] double feed_in_effect() const noexcept {
    return feed_in_effect_.load(std::memory_order_relaxed);
  }

  /// One try or look, on the thread that has the link. How long to wait then [s]; nothing when the
  /// link does not answer.
  std::optional<double> turn();
  /// Back to what the operator has set, in a few tries. False when that was not acknowledged.
  bool give_back();
  [[nodiscard]] OverrideHealth health() const;

 private:
  struct Setting {
    double speed = 1, feed = 1;
  };
  std::optional<double> look();
  std::optional<double> send(double base, double ratio, double& acknowledged, bool spindle);

  CncLink& link_;
  OverrideRequestConfig config_;
  std::atomic<double> speed_{1}, feed_{1}, feed_in_effect_{1};
  std::atomic<bool> taken_over_{false};

  std::optional<Setting> operator_;  // what he has set; the thread's own, down to here
  Setting sent_;                     // acknowledged, as the control counts it
  bool yielded_ = false;
  Nanoseconds sent_ns_ = 0, looked_ns_ = 0;

  mutable std::mutex mutex_;  // of health_
  OverrideHealth health_;
};

}  // namespace servosense
