#include "torque_band_plan.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <string>
#include <utility>

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"
#include "servosense/monitors/torque_band_file.hpp"

namespace servosense {
namespace {

constexpr const char* kSection = "monitor.torque-band";
// Shifts are worked on as often a second as at 8 kHz with one a sample.
constexpr double kShiftsPerSecond = 8000;

}  // namespace

TorqueBandConfig torque_band_defaults(bool over_path) {
  TorqueBandConfig c;
  c.over_path = over_path;
  // A feed of 10 mm/s makes the one of the other.
  const double unit = over_path ? 0.01 : 1;
  c.step = 0.05 * unit;
  c.shift_step = 0.04 * unit;
  c.max_shift = 1.0 * unit;
  c.sync_shift = 0.2 * unit;
  return c;
}

void use_torque_band(StackPlan& plan, TorqueBandReference reference) {
  ToolMonitorsConfig& tool = plan.config.tool;
  TorqueBandConfig& c = tool.torque_band;
  c = torque_band_defaults(reference.over_path);
  c.spacing = reference.spacing;
  c.air_limit_Nm = reference.air_limit_Nm;
  c.has_cuts = !reference.cuts.empty();
  c.shifts_per_sample = std::max(
      1U, static_cast<unsigned>(std::ceil(tool.torque_band_advance * kShiftsPerSecond - 1e-9)));
  plan.torque_band = std::move(reference.points);
  plan.torque_band_sections = std::move(reference.sections);
  plan.expected_cuts = std::move(reference.cuts);
  plan.engagements = std::move(reference.engagements);
}

Expected<Obstacle> plan_torque_band(const MachineFile& machine, double pace_s,
                                    const StackSignals& signals, StackPlan& plan) {
  ToolMonitorsConfig& tool = plan.config.tool;
  tool.torque_band_advance = pace_s;
  tool.torque_band = torque_band_defaults(false);
  tool.torque_band.spacing = tool.torque_band.step;
  if (!plan.config.spindle.present)
    return Obstacle{"no signals", "needs the spindle's angle or speed and its current or torque"};
  const auto file = machine.text(kSection, "reference");
  if (!file)
    return Obstacle{
        "no reference",
        "has no reference; run 'servosense identify torque-band' and write reference in "
        "[monitor.torque-band]"};
  if (!machine.flag(kSection, "enabled").value_or(true)) return Obstacle{};
  const std::string path = machine.beside(*file);
  PredictedBand band;
  std::string asked;
  for (const auto& [key, to] :
       {std::pair{"tolerance_share", &band.share}, std::pair{"tolerance_s", &band.time_s}})
    if (const auto value = machine.number(kSection, key)) *to = *value, asked = key;
  band.torque_Nm = machine.number(kSection, "tolerance_Nm");
  if (band.torque_Nm) asked = "tolerance_Nm";
  band.teeth = static_cast<unsigned>(machine.number("tool", "teeth").value_or(0));
  for (const HostAxisSlotConfig& axis : plan.config.axis)
    if (axis.present)
      band.force_cutoff_rad_s = std::max(band.force_cutoff_rad_s, axis.collision.cutoff_rad_s);
  auto reference = read_torque_band(path, band);
  if (!reference) return reference.error();
  if (!asked.empty() && !reference->predicted)
    return data_error(machine.where(kSection, asked) + ": " + asked + " does not fit " + path +
                      ", which was taught and has its limits; it is for a table of 'program "
                      "predict'");
  use_torque_band(plan, *std::move(reference));
  TorqueBandConfig& c = tool.torque_band;
  const std::string unit = c.over_path ? "_m" : "_s";
  const std::string other = c.over_path ? "_s" : "_m";
  for (const auto& [key, to] :
       {std::pair{"step", &c.step}, std::pair{"max_shift", &c.max_shift},
        std::pair{"shift_step", &c.shift_step}, std::pair{"sync_shift", &c.sync_shift}}) {
    if (const auto value = machine.number(kSection, key + unit)) *to = *value;
    if (machine.has(kSection, key + other))
      return data_error(machine.where(kSection) + ": " + key + other + " does not fit " + path +
                        ", whose points lie over " + (c.over_path ? "path" : "time") + "; write " +
                        key + unit);
  }
  for (const auto& [key, to] :
       {std::pair{"max_drift", &c.max_drift}, std::pair{"memory_steps", &c.memory_steps},
        std::pair{"alarm_steps", &c.alarm_steps}, std::pair{"air_limit_Nm", &c.air_limit_Nm},
        std::pair{"warning_fraction", &c.warning_fraction}})
    if (const auto value = machine.number(kSection, key)) *to = *value;
  c.release_fraction = std::min(c.release_fraction, c.warning_fraction);
  // A revolution is told by the samples in it.
  double slowest_rad_s = 0;
  for (const auto& section : plan.torque_band_sections)
    if (section.speed_rad_s > 0 && !(slowest_rad_s > 0 && slowest_rad_s <= section.speed_rad_s))
      slowest_rad_s = section.speed_rad_s;
  if (slowest_rad_s * signals.sample_period_s > kTwoPi)
    return Obstacle{"slow signal",
                    "needs a sample a revolution at least: the spindle of its reference turns at " +
                        printed(rpm_from_rad_s(slowest_rad_s)) + " rpm, the signal has " +
                        printed(1 / signals.sample_period_s) + " Hz"};
  if (c.over_path && std::none_of(signals.axis.begin(), signals.axis.end(),
                                  [](const auto& axis) { return axis.has_value(); }))
    return Obstacle{"no signals",
                    "needs the position of the feed axes: its reference lies over path"};
  return Obstacle{};
}

std::string torque_band_watches(const StackPlan& plan, const StackSignals& signals) {
  const TorqueBandConfig& c = plan.config.tool.torque_band;
  const double length = c.spacing * static_cast<double>(plan.torque_band.size());
  std::string text =
      "holds the torque against " + printed(length) + (c.over_path ? " m" : " s") + " of program";
  if (plan.torque_band_sections.empty()) return text;
  std::set<std::int32_t> blocks;
  for (const auto& s : plan.torque_band_sections)
    if (s.block != kNoBlock) blocks.insert(s.block);
  text += " in " + std::to_string(plan.torque_band_sections.size()) + " section(s)";
  if (!blocks.empty())
    text += signals.nc_block ? ", found by nc_block"
                             : ", found by the spindle alone: the trace has no machine.nc_block";
  return text;
}

}  // namespace servosense
