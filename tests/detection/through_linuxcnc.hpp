// A LinuxCNC between what is commanded and the simulated machine, which keeps to the clock and has
// the overrides and the feed hold that LinuxCNC acknowledges.
#pragma once

#include <algorithm>

#include "check.hpp"
#include "detection/closed_loop.hpp"
#include "servosense/hal/linuxcnc_link.hpp"
#include "servosense/hal/override_request.hpp"
#include "servosense/hal/stop_request.hpp"

namespace detection {

class ThroughLinuxCnc {
 public:
  explicit ThroughLinuxCnc(const char* url)
      : link_(good(linuxcnc_config(url), "address")),
        overrides_(link_),
        stop_(link_, {}, {}, [this] { return overrides_.turn(); }) {
    CHECK(link_.connect() == CncReply::done);
    stop_.start();
    began_ = link_.now_ns();
  }
  MachineOverride operator()(double t_s, const MachineOverride& set) {
    overrides_.set(set.speed, set.feed);
    if (set.hold && !held_) stop_.raise(link_.now_ns());
    held_ = set.hold;
    if (t_s >= next_s_) {
      next_s_ += kTick_s;
      const double ahead = t_s - seconds_from(link_.now_ns() - began_);
      late_s_ = std::max(late_s_, -ahead);
      if (ahead > 0) link_.wait(ahead);
    }
    const OverrideHealth h = overrides_.health();
    least_ = {std::min(least_.speed, h.speed), std::min(least_.feed, h.feed)};
    greatest_ = {std::max(greatest_.speed, h.speed), std::max(greatest_.feed, h.feed)};
    const MachineOverride now{h.speed, h.feed, stop_.health().holding};
    if (now.hold && hold_s_ == kNever) hold_s_ = t_s;
    return now;
  }
  /// The overrides are given back.
  void end() {
    stop_.stop();
    CHECK(overrides_.give_back());
    CncOverrides last;
    CHECK(link_.overrides(last) == CncReply::done && last.feed == 1 && last.spindle == 1);
    const OverrideHealth h = overrides_.health();
    CHECK(h.takeovers == 0 && h.refused == 0);
  }
  [[nodiscard]] OverrideHealth health() { return overrides_.health(); }
  [[nodiscard]] const MachineOverride& least() const { return least_; }
  [[nodiscard]] const MachineOverride& greatest() const { return greatest_; }
  /// Time of the simulation at which LinuxCNC has acknowledged the hold.
  [[nodiscard]] double hold_s() const { return hold_s_; }
  [[nodiscard]] double late_s() const { return late_s_; }

 private:
  static constexpr double kTick_s = 0.005;  // at which the simulation waits for the clock

  LinuxCncLink link_;
  OverrideRequest overrides_;
  StopRequest stop_;
  Nanoseconds began_ = 0;
  double next_s_ = 0, late_s_ = 0, hold_s_ = kNever;
  bool held_ = false;
  MachineOverride least_, greatest_;
};

}  // namespace detection
