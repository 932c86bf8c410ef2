// Configuration of the monitor stack (monitor_stack.hpp), and what it becomes when the monitors
// hear of several samples as of one.
//
// A stack that cannot alarm does not validate: at least one drive is present, and the monitor of
// each has a threshold, an inertia and, on an axis, a lead. Who wants estimates alone says so:
// chatter_on = false, collision_on = false.
#pragma once

#include <array>

#include "servosense/core/channel.hpp"
#include "servosense/core/drive_sample.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/monitors/chatter.hpp"
#include "servosense/monitors/collision.hpp"
#include "servosense/monitors/cut_detector.hpp"
#include "servosense/monitors/signal_health.hpp"
#include "servosense/monitors/tool_monitors.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

/// One drive of the stack.
struct DriveSlotConfig {
  bool present = false;
  DriveInputConfig input;
  DisturbanceObserverConfig observer;          ///< of the reported estimate
  DisturbanceObserverConfig monitor_observer;  ///< of the monitor; equal cutoffs share one observer
  SignalHealthConfig signal;
};

struct SpindleSlotConfig : DriveSlotConfig {
  bool chatter_on = true;  ///< false: estimates alone; thresholds may then be 0
  ChatterConfig chatter;
};

struct AxisSlotConfig : DriveSlotConfig {
  bool collision_on = true;  ///< likewise
  CollisionConfig collision;
  DisturbanceObserverConfig tool_observer;  ///< of x and y, for the monitors of the tool
};

struct MonitorStackConfig {
  SpindleSlotConfig spindle;
  std::array<AxisSlotConfig, kAxes> axis;
  CutDetectorConfig cut;  ///< for the collision monitors
  ToolMonitorsConfig tool;
  /// Observers and monitors hear of two servo periods of the spindle and of four of an axis as of
  /// one: sum of motion, mean effort, the faults of all. Theirs, but not signal health's, is then a
  /// sample_period_s of so many servo periods; drill fracture, wear and torque band go with the
  /// axes. Inputs are conditioned and watched every period all the same.
  bool grouped = false;
};

/// The same stack with `grouped`, from a configuration for the servo rate: periods, and what is
/// counted in samples. A contact then has to last as long to be confirmed, two samples at least.
[[nodiscard]] inline MonitorStackConfig in_groups(MonitorStackConfig c) noexcept {
  constexpr unsigned kSpindle = 2, kAxis = 4;
  const unsigned tool = c.tool.half_rate ? kAxis / 2 : kAxis;
  c.grouped = true;
  c.tool.half_rate = false;
  for (double* period :
       {&c.spindle.observer.sample_period_s, &c.spindle.monitor_observer.sample_period_s,
        &c.spindle.chatter.sample_period_s, &c.cut.sample_period_s,
        &c.tool.ar_breakage.sample_period_s, &c.tool.tooth_breakage.sample_period_s})
    *period *= kSpindle;
  c.spindle.observer.averaged = c.spindle.monitor_observer.averaged = kSpindle;
  c.tool.ar_breakage.stages_per_sample *= kSpindle;
  for (double* period : {&c.tool.drill_fracture.sample_period_s, &c.tool.wear.sample_period_s,
                         &c.tool.torque_band_advance})
    *period *= tool;
  unsigned& window = c.tool.drill_fracture.window_samples;
  window = (window + tool - 1) / tool;
  for (AxisSlotConfig& axis : c.axis) {
    axis.observer.sample_period_s *= kAxis;
    axis.monitor_observer.sample_period_s *= kAxis;
    axis.tool_observer.sample_period_s *= tool;
    axis.observer.averaged = axis.monitor_observer.averaged = axis.tool_observer.averaged = kAxis;
    CollisionConfig& contact = axis.collision;
    contact.sample_period_s *= kAxis;
    contact.release_samples = (contact.release_samples + kAxis - 1) / kAxis;
    if (contact.consecutive_samples > 2)
      contact.consecutive_samples = contact.consecutive_samples > 2 * kAxis
                                        ? (contact.consecutive_samples + kAxis - 1) / kAxis
                                        : 2;
  }
  return c;
}

}  // namespace servosense
