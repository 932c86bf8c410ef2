#include "servosense/monitors/learned_under.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>

#include "servosense/core/plausible.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/monitors/collision_keys.hpp"
#include "servosense/observer/machine_config.hpp"

namespace servosense {
namespace {

struct Condition {
  std::string key;
  std::string what;  ///< as a reader knows it, with its unit
  std::vector<double> now;
};

constexpr const char* kRate = "learned_sample_rate_hz";

double counts_per_turn(const DriveInputConfig& input) {
  return input.kind == MotionKind::counts && input.unit_per_count != 0
             ? std::round(std::abs(input.unit_per_turn / input.unit_per_count))
             : 0;
}

const HostDriveSlotConfig& slot_of(const HostStackConfig& config, Channel channel) {
  if (is_axis(channel)) return config.axis[axis_index(channel)];
  return config.spindle;
}

std::vector<Condition> conditions(const HostStackConfig& config, MonitorId monitor,
                                  Channel channel) {
  const HostDriveSlotConfig& slot = slot_of(config, channel);
  const bool axis = monitor == MonitorId::collision;
  const std::string counts =
      axis ? CollisionKeys(channel).learned_counts : "learned_counts_per_rev";
  std::vector<Condition> all = {
      {kRate, "sample rate [Hz]", {1 / slot.input.sample_period_s}},
      {"learned_cutoff_rad_s",
       "observer cutoff [rad/s]",
       {slot.monitor_observer.disturbance_cutoff_rad_s}},
      {"learned_velocity_cutoff_rad_s",
       "velocity cutoff [rad/s]",
       {slot.monitor_observer.velocity_cutoff_rad_s}},
      {counts, "encoder counts a turn (0: a position or a speed)", {counts_per_turn(slot.input)}}};
  if (axis) {
    const auto& notch = config.axis[axis_index(channel)].collision.notch_hz;
    all.push_back({"learned_notch_hz", "notches [Hz]", {notch.begin(), notch.end()}});
  } else if (monitor == MonitorId::chatter) {
    const ChatterConfig& chatter = config.spindle.chatter;
    all.push_back({"learned_teeth", "teeth (0: unknown)", {double(chatter.teeth)}});
    all.push_back({"learned_harmonics", "harmonics", {double(chatter.harmonics)}});
    all.push_back({"learned_window_revolutions",
                   "revolutions in the window",
                   {double(chatter.window_revolutions)}});
  } else {
    all.push_back({"learned_teeth", "teeth", {double(config.tool.ar_breakage.teeth)}});
  }
  return all;
}

// A noise power that goes with the fourth power of a rate is off by 8 % where the rate is by
// kSameRate; half as much again over the peak covers that.
bool same(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), [](double x, double y) {
           return std::abs(x - y) <= kSameRate * std::max(std::abs(x), std::abs(y));
         });
}

std::string listed(const std::vector<double>& values) {
  std::string all;
  for (const double value : values) {
    char text[32];
    std::snprintf(text, sizeof text, "%.9g", value);
    all += (all.empty() ? "" : ", ") + std::string(text);
  }
  return all;
}

std::optional<std::vector<double>> stated(const MachineFile& machine, const std::string& section,
                                          const Condition& condition) {
  if (condition.now.size() != 1) return machine.list(section, condition.key);
  if (const auto value = machine.number(section, condition.key)) return std::vector{*value};
  return std::nullopt;
}

std::vector<std::string> differences(const MachineFile& machine, const std::string& section,
                                     const std::vector<Condition>& all) {
  std::vector<std::string> found;
  for (const Condition& condition : all)
    if (const auto then = stated(machine, section, condition); then && !same(*then, condition.now))
      found.push_back(condition.what + " " + listed(*then) + ", now " + listed(condition.now));
  return found;
}

// Of the axes of the section that were not heard this time, and of the cut: learned under what is
// overwritten now.
std::vector<std::string> remove_others(MachineFile& machine, const std::string& section,
                                       Channel heard) {
  std::vector<std::string> removed;
  for (std::size_t i = 0; i < kAllAxes; ++i) {
    const Channel axis = axis_channel(i);
    const CollisionKeys keys(axis);
    if (keys.section != section) continue;
    for (const std::string& key :
         {keys.threshold, keys.phase_thresholds, keys.cutting_threshold, keys.learned_counts}) {
      const bool anew = axis == heard && !key.starts_with("cutting");
      if (anew || !machine.has(section, key)) continue;
      machine.remove(section, key);
      removed.push_back(key + " is removed from [" + section +
                        "]: it was learned under other conditions than this record's");
    }
  }
  return removed;
}

}  // namespace

std::vector<std::string> write_learned_under(MachineFile& machine, const HostStackConfig& config,
                                             Channel drive) {
  std::vector<std::string> removed;
  const auto write = [&](MonitorId monitor, Channel channel) {
    const std::string section = monitor_section(monitor, channel);
    if (!machine.has_section(section)) return;
    const std::vector<Condition> all = conditions(config, monitor, channel);
    if (monitor == MonitorId::collision && !differences(machine, section, all).empty())
      removed = remove_others(machine, section, channel);
    for (const Condition& condition : all) {
      std::vector<double> rounded;
      for (const double value : condition.now)
        rounded.push_back(std::strtod(listed({value}).c_str(), nullptr));
      if (rounded.size() == 1)
        machine.set(section, condition.key, rounded[0]);
      else
        machine.set(section, condition.key, std::span<const double>(rounded));
    }
  };
  if (!is_spindle(drive)) {
    write(MonitorId::collision, drive);
    return removed;
  }
  if (machine.has(monitor_section(MonitorId::chatter, drive), "chatter_threshold_Nm2"))
    write(MonitorId::chatter, drive);
  if (drive != tool_spindle(machine)) return removed;
  for (const MonitorId monitor : {MonitorId::ar_breakage, MonitorId::tooth_breakage})
    if (machine.has(monitor_section(monitor, Channel::tool), "noise_Nm"))
      write(monitor, Channel::tool);
  return removed;
}

std::string learned_elsewhere(const MachineFile& machine, const HostStackConfig& config,
                              MonitorId monitor, Channel channel) {
  std::string all;
  for (const std::string& difference : differences(machine, monitor_section(monitor, channel),
                                                   conditions(config, monitor, channel)))
    all += (all.empty() ? "" : "; ") + difference;
  if (all.empty()) return all;
  return "was learned under other conditions (" + all +
         "); run 'servosense identify idle' under the present ones, or go back to those";
}

bool states_conditions(const MachineFile& machine, MonitorId monitor, Channel channel) {
  return machine.has(monitor_section(monitor, channel), kRate);
}

}  // namespace servosense
