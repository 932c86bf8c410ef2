// Configuration of the monitor stack (monitor_stack.hpp), and what it becomes when the monitors
// hear of several samples as of one.
//
// A stack that cannot alarm does not validate: at least one drive is present, and the monitor of
// each has a threshold, an inertia and, on an axis, a lead. Who wants estimates alone says so:
// chatter_on = false, collision_on = false.
#pragma once

#include <array>

#include "servosense/core/channel.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/monitors/chatter.hpp"
#include "servosense/monitors/collision.hpp"
#include "servosense/monitors/cut_detector.hpp"
#include "servosense/monitors/signal_health.hpp"
#include "servosense/monitors/tool_monitors.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

/// One drive of the stack. `Observer`: DisturbanceObserverView, which leaves the effects of the
/// drive where they lie (in flash); DisturbanceObserverConfig with a copy of them for hosts.
template <typename Observer>
struct DriveSlotConfigWith {
  bool present = false;
  DriveInputConfig input;
  Observer observer;          ///< of the reported estimate
  Observer monitor_observer;  ///< of the monitor; equal cutoffs share one observer
  SignalHealthConfig signal;
};

template <typename Observer>
struct SpindleSlotConfigWith : DriveSlotConfigWith<Observer> {
  bool chatter_on = true;  ///< false: estimates alone; thresholds may then be 0
  ChatterConfig chatter;
};

template <typename Observer>
struct AxisSlotConfigWith : DriveSlotConfigWith<Observer> {
  bool collision_on = true;  ///< likewise
  CollisionConfig collision;
  Observer tool_observer;  ///< of x and y, for the monitors of the tool
};

template <typename Observer, std::size_t Axes = kAxes>
struct MonitorStackConfigWith {
  SpindleSlotConfigWith<Observer> spindle;
  std::array<AxisSlotConfigWith<Observer>, Axes> axis;  ///< x, y, z, then a, b, c in rad and Nm
  CutDetectorConfig cut;                                ///< for the collision monitors
  ToolMonitorsConfig tool;
  /// Observers and monitors hear of two servo periods of the spindle and of four of an axis as of
  /// one: sum of motion, mean effort, the faults of all. Theirs, but not signal health's, is then a
  /// sample_period_s of so many servo periods; drill fracture, wear and torque band go with the
  /// axes. Inputs are conditioned and watched every period all the same.
  bool grouped = false;
};

/// 3 kB. The effects it points to must live until the stack is configured, and no longer.
using MonitorStackConfig = MonitorStackConfigWith<DisturbanceObserverView>;
using DriveSlotConfig = DriveSlotConfigWith<DisturbanceObserverView>;
using SpindleSlotConfig = SpindleSlotConfigWith<DisturbanceObserverView>;
using AxisSlotConfig = AxisSlotConfigWith<DisturbanceObserverView>;

/// 90 kB, nearly all of it room for the effects of every observer.
using HostStackConfig = MonitorStackConfigWith<DisturbanceObserverConfig, kAllAxes>;
using HostDriveSlotConfig = DriveSlotConfigWith<DisturbanceObserverConfig>;
using HostSpindleSlotConfig = SpindleSlotConfigWith<DisturbanceObserverConfig>;
using HostAxisSlotConfig = AxisSlotConfigWith<DisturbanceObserverConfig>;

namespace detail {
inline void view_slot(const HostDriveSlotConfig& from, DriveSlotConfig& to) noexcept {
  to.present = from.present;
  to.input = from.input;
  to.observer = view_of(from.observer);
  to.monitor_observer = view_of(from.monitor_observer);
  to.signal = from.signal;
}
}  // namespace detail

/// `c` with all effects left where they are: `c` must outlive the use of what is returned. Of the
/// first `Axes` axes.
template <std::size_t Axes = kAxes>
[[nodiscard]] MonitorStackConfigWith<DisturbanceObserverView, Axes> view_of(
    const HostStackConfig& c) noexcept {
  MonitorStackConfigWith<DisturbanceObserverView, Axes> view;
  detail::view_slot(c.spindle, view.spindle);
  view.spindle.chatter_on = c.spindle.chatter_on;
  view.spindle.chatter = c.spindle.chatter;
  for (std::size_t i = 0; i < Axes; ++i) {
    detail::view_slot(c.axis[i], view.axis[i]);
    view.axis[i].collision_on = c.axis[i].collision_on;
    view.axis[i].collision = c.axis[i].collision;
    view.axis[i].tool_observer = view_of(c.axis[i].tool_observer);
  }
  view.cut = c.cut;
  view.tool = c.tool;
  view.grouped = c.grouped;
  return view;
}

/// Makes of a configuration for the servo rate one with `grouped`: periods, and what is counted in
/// samples. A contact then has to last as long to be confirmed, two samples at least.
template <typename Observer, std::size_t Axes>
void group(MonitorStackConfigWith<Observer, Axes>& c) noexcept {
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
  for (AxisSlotConfigWith<Observer>& axis : c.axis) {
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
}

/// The same stack with `grouped`.
template <typename Observer, std::size_t Axes>
[[nodiscard]] MonitorStackConfigWith<Observer, Axes> in_groups(
    MonitorStackConfigWith<Observer, Axes> c) noexcept {
  group(c);
  return c;
}

}  // namespace servosense
