#include "torque_band_plan.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "servosense/core/units.hpp"
#include "servosense/io/text.hpp"
#include "servosense/monitors/torque_band_file.hpp"

namespace servosense {
namespace {

constexpr const char* kBandSection = "monitor.torque-band";
/// Lines weaker than that, over the mean, are shape and not teeth; those of which the observer
/// leaves less than a quarter are noise; and a line takes four samples a period (chosen).
constexpr double kLeastLine = 0.05, kLeastLeft = 0.25, kSamplesAPeriod = 4;
// Shifts are worked on as often a second as at 8 kHz with one a sample.
constexpr double kShiftsPerSecond = 8000;

/// Over the mean: half the amplitude of the k-th multiple of a tooth that cuts h ~ sin(phi) between
/// two angles, its edge lagging by `lag_rad` at the top of the cut.
double line_share(const PredictedEngagement& e, double lag_rad, unsigned k) {
  const auto integral = [](double from, double to, double order) {
    // Of sin(phi) exp(-i k phi), as two of exp.
    const std::complex<double> i(0, 1);
    const auto of = [&](double m) {
      return m == 0 ? std::complex<double>(to - from)
                    : (std::exp(i * m * to) - std::exp(i * m * from)) / (i * m);
    };
    return (of(1 - order) - of(-1 - order)) / (2.0 * i);
  };
  const double lag = k * lag_rad / 2, spread = lag > 1e-9 ? std::sin(lag) / lag : 1;
  const double mean = std::abs(integral(e.start_rad, e.exit_rad, 0));
  return mean > 0 ? std::abs(integral(e.start_rad, e.exit_rad, k) * spread) / mean : 0;
}

/// What two equal lags, and means over parts of a revolution, leave of a line.
double line_left(const HostDriveSlotConfig& spindle, double speed_rad_s, unsigned k) {
  const auto lag = [&](double cutoff_rad_s) {
    return 1 / std::hypot(1, k * speed_rad_s / cutoff_rad_s);
  };
  const double part = kPi * k / double{ToothCount<double>::kParts};
  return lag(spindle.observer.disturbance_cutoff_rad_s) *
         lag(spindle.observer.velocity_cutoff_rad_s) * std::sin(part) / part;
}

/// Which lines tell the teeth of the program's tool, or why none does.
void plan_tooth_count(const MachineFile& machine, double pace_s, StackPlan& plan) {
  const auto kind = machine.text("tool", "kind");
  const auto teeth = machine.number("tool", "teeth"),
             diameter = machine.number("tool", "diameter_m");
  if (plan.expected_cuts.empty()) {
    plan.teeth_not_counted = "its reference does not say how the cutter is engaged";
    return;
  }
  if (plan.engagements.empty() || (kind && *kind != "flat" && *kind != "face")) {
    plan.teeth_not_counted = "that takes one flat tool and cuts of one arc";
    return;
  }
  if (!teeth || !diameter || *teeth > kToothLines) {
    plan.teeth_not_counted = "[tool] has no teeth, or more than " + std::to_string(kToothLines);
    return;
  }
  // The fastest that an engagement is cut at.
  std::vector<double> speed_rad_s(plan.engagements.size());
  std::size_t section = 0;
  const auto& sections = plan.torque_band_sections;
  for (std::size_t i = 0; i < plan.expected_cuts.size(); ++i) {
    while (section + 1 < sections.size() && sections[section + 1].first <= i) ++section;
    const ExpectedCut<double>& cut = plan.expected_cuts[i];
    if (cut.kind != ExpectedCutKind::steady || sections.empty()) continue;
    double& speed = speed_rad_s[cut.engagement];
    speed = std::max(speed, sections[section].speed_rad_s);
  }
  const double lag_per_m =
      std::tan(rad_from_deg(machine.number("tool", "helix_deg").value_or(0))) / (*diameter / 2);
  bool any = false;
  for (std::size_t i = 0; i < plan.engagements.size(); ++i) {
    const PredictedEngagement& e = plan.engagements[i];
    ToothLines<double>& lines = plan.tooth_lines.emplace_back();
    for (unsigned k = 1; k <= kToothLines; ++k) {
      const double share = line_share(e, lag_per_m * e.axial_depth_m, k);
      const double left = line_left(plan.config.spindle, speed_rad_s[i], k);
      const double samples = kTwoPi / (speed_rad_s[i] * k * pace_s);
      if (share >= kLeastLine && left >= kLeastLeft && samples >= kSamplesAPeriod)
        lines.share[k - 1] = share * left;
    }
    any = any || lines.share[static_cast<std::size_t>(*teeth) - 1] > 0;
  }
  if (any) {
    plan.config.tool.torque_band.tooth_count.teeth = static_cast<unsigned>(*teeth);
    return;
  }
  plan.tooth_lines.clear();
  plan.teeth_not_counted = "at this speed and rate, and in these cuts, " + printed(*teeth) +
                           " teeth leave nothing in the torque that is seen";
}

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
  plan.torque_band_changes = std::move(reference.changes);
}

Expected<Obstacle> plan_torque_band(const MachineFile& machine, double pace_s,
                                    const StackSignals& signals, StackPlan& plan) {
  ToolMonitorsConfig& tool = plan.config.tool;
  tool.torque_band_advance = pace_s;
  tool.torque_band = torque_band_defaults(false);
  tool.torque_band.spacing = tool.torque_band.step;
  if (!plan.config.spindle.present)
    return Obstacle{"no signals", "needs the spindle's angle or speed and its current or torque"};
  const auto file = machine.text(kBandSection, "reference");
  if (!file)
    return Obstacle{
        "no reference",
        "has no reference; run 'servosense identify torque-band' and write reference in "
        "[monitor.torque-band]"};
  if (!machine.flag(kBandSection, "enabled").value_or(true)) return Obstacle{};
  const std::string path = machine.beside(*file);
  PredictedBand band;
  std::string asked;
  for (const auto& [key, to] :
       {std::pair{"tolerance_share", &band.share}, std::pair{"tolerance_s", &band.time_s}})
    if (const auto value = machine.number(kBandSection, key)) *to = *value, asked = key;
  band.torque_Nm = machine.number(kBandSection, "tolerance_Nm");
  if (band.torque_Nm) asked = "tolerance_Nm";
  band.teeth = static_cast<unsigned>(machine.number("tool", "teeth").value_or(0));
  for (const HostAxisSlotConfig& axis : plan.config.axis)
    if (axis.present)
      band.force_cutoff_rad_s = std::max(band.force_cutoff_rad_s, axis.collision.cutoff_rad_s);
  auto reference = read_torque_band(path, band);
  if (!reference) return reference.error();
  if (!asked.empty() && !reference->predicted)
    return data_error(machine.where(kBandSection, asked) + ": " + asked + " does not fit " + path +
                      ", which was taught and has its limits; it is for a table of 'program "
                      "predict'");
  use_torque_band(plan, *std::move(reference));
  plan_tooth_count(machine, pace_s, plan);
  TorqueBandConfig& c = tool.torque_band;
  const std::string unit = c.over_path ? "_m" : "_s";
  const std::string other = c.over_path ? "_s" : "_m";
  for (const auto& [key, to] :
       {std::pair{"step", &c.step}, std::pair{"max_shift", &c.max_shift},
        std::pair{"shift_step", &c.shift_step}, std::pair{"sync_shift", &c.sync_shift}}) {
    if (const auto value = machine.number(kBandSection, key + unit)) *to = *value;
    if (machine.has(kBandSection, key + other))
      return data_error(machine.where(kBandSection) + ": " + key + other + " does not fit " + path +
                        ", whose points lie over " + (c.over_path ? "path" : "time") + "; write " +
                        key + unit);
  }
  for (const auto& [key, to] :
       {std::pair{"max_drift", &c.max_drift}, std::pair{"memory_steps", &c.memory_steps},
        std::pair{"alarm_steps", &c.alarm_steps}, std::pair{"air_limit_Nm", &c.air_limit_Nm},
        std::pair{"warning_fraction", &c.warning_fraction}})
    if (const auto value = machine.number(kBandSection, key)) *to = *value;
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
  text += plan.tooth_lines.empty()
              ? "; does not count teeth: " + plan.teeth_not_counted
              : "; counts teeth where " + printed(c.tooth_count.teeth) + " would show";
  return text;
}

}  // namespace servosense
