#include "tool_plan.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <utility>

#include "drive_plan.hpp"
#include "obstacle.hpp"
#include "servosense/io/text.hpp"
#include "servosense/monitors/learned_under.hpp"
#include "torque_band_plan.hpp"

namespace servosense {
namespace {

// Range of the block (angle_sampler.hpp).
constexpr double kSamplesATooth = 8;
// Where no speed of the cut is stated, a breakage monitor has to follow this one at least.
// Convention: below it mill cutters of 0.1 m and more.
constexpr double kSlowCut_rpm = 600;
// A hole takes seconds: a drill that is judged later is judged too late. Convention.
constexpr double kDrillLatest_s = 5;
constexpr double kDrillAverage = 64;  // samples of its mean (drill_fracture.hpp)

class ToolPlan {
 public:
  ToolPlan(const MachineFile& machine, double period, StackPlan& plan)
      : machine_(machine),
        plan_(plan),
        tool_(plan.config.tool),
        period_(period),
        pace_(period),
        spindle_(plan.config.spindle.present),
        teeth_(static_cast<unsigned>(machine.number("tool", "teeth").value_or(0))) {}

  void ar_breakage();
  void tooth_breakage();
  /// Of the monitors that hear at this pace: drill fracture, wear and torque band.
  void pace();
  void drill_fracture();
  void wear();
  Expected<Done> torque_band(const StackSignals& signals);

 private:
  void number(const char* section, const char* key, double& to) const {
    if (const auto value = machine_.number(section, key)) to = *value;
  }
  void whole(const char* section, const char* key, unsigned& to) const {
    if (const auto value = machine_.number(section, key)) to = static_cast<unsigned>(*value);
  }
  [[nodiscard]] double fastest_rpm() const {
    return 60 / (kSamplesATooth * period_ * std::max(teeth_, 1U));
  }
  [[nodiscard]] std::string teeth_up_to() const {
    return std::to_string(teeth_) + " teeth, up to " + printed(fastest_rpm()) + " rpm";
  }
  /// Its line of the plan; whether it runs.
  bool line(MonitorId id, const char* section, const Obstacle& missing, const std::string& watches);
  /// What keeps either breakage monitor from running; `noise`: it has learned it.
  [[nodiscard]] Obstacle breakage_lacks(MonitorId id, bool noise, const char* key) const;
  [[nodiscard]] std::optional<std::array<double, 2>> taught(const char* mean,
                                                            const char* scatter) const;

  const MachineFile& machine_;
  StackPlan& plan_;
  ToolMonitorsConfig& tool_;
  double period_, pace_;
  bool spindle_;
  unsigned teeth_;
};

bool ToolPlan::line(MonitorId id, const char* section, const Obstacle& missing,
                    const std::string& watches) {
  MonitorAvailability m{id, Channel::tool, true, watches, ""};
  if (!enabled(machine_, section))
    keep_from(m, switched_off());
  else if (!missing.none())
    keep_from(m, missing);
  else if (id == MonitorId::ar_breakage || id == MonitorId::tooth_breakage)
    m.reason += unknown_conditions(machine_, id, Channel::tool);
  plan_.monitors.push_back(m);
  return m.runs;
}

Obstacle ToolPlan::breakage_lacks(MonitorId id, bool noise, const char* key) const {
  if (!spindle_) return no_spindle();
  if (teeth_ < 2) return {"no teeth", "needs a tool of two teeth or more; write teeth in [tool]"};
  if (teeth_ > kHostTeeth)
    return {"too many teeth", "has room for " + std::to_string(kHostTeeth) + " teeth"};
  const double cut_rpm = machine_.number("cut", "spindle_speed_rpm").value_or(kSlowCut_rpm);
  if (fastest_rpm() < cut_rpm)
    return {"slow signal", "needs at least " + printed(kSamplesATooth * teeth_ * cut_rpm / 60) +
                               " Hz for " + std::to_string(teeth_) + " teeth at " +
                               printed(cut_rpm) + " rpm, eight samples a tooth; the signal has " +
                               printed(1 / period_) + " Hz"};
  if (!noise)
    return {"no threshold", std::string("has not learned its noise; run 'servosense identify "
                                        "idle' with [tool] teeth, or write ") +
                                key};
  return elsewhere(machine_, plan_, id, Channel::tool);
}

void ToolPlan::ar_breakage() {
  constexpr const char* section = "monitor.ar-breakage";
  tool_.ar_breakage.sample_period_s = period_;
  tool_.ar_breakage.teeth = teeth_;
  number(section, "noise_Nm", tool_.ar_breakage.noise_Nm);
  number(section, "share_threshold", tool_.ar_breakage.share_threshold);
  number(section, "warning_fraction", tool_.ar_breakage.warning_fraction);
  tool_.ar_breakage_on =
      line(MonitorId::ar_breakage, section,
           breakage_lacks(MonitorId::ar_breakage, machine_.has(section, "noise_Nm"),
                          "noise_Nm in [monitor.ar-breakage]"),
           "watches the torque of " + teeth_up_to());
}

void ToolPlan::tooth_breakage() {
  constexpr const char* section = "monitor.tooth-breakage";
  const bool force = machine_.text(section, "signal").value_or("torque") == "force";
  ToothBreakageConfig& t = tool_.tooth_breakage;
  t.sample_period_s = period_;
  t.teeth = teeth_;
  t.torque = !force;
  number(section, force ? "noise_N" : "noise_Nm", t.noise);
  number(section, force ? "sample_noise_N" : "sample_noise_Nm", t.sample_noise);
  number(section, "tolerated_throw", t.tolerated_throw);
  number(section, "swept_angle_rad", t.swept_angle_rad);
  number(section, "warning_fraction", t.warning_fraction);
  Obstacle missing = breakage_lacks(
      MonitorId::tooth_breakage, machine_.has(section, force ? "noise_N" : "noise_Nm"),
      force ? "noise_N in [monitor.tooth-breakage]" : "noise_Nm in [monitor.tooth-breakage]");
  if (missing.none() && force && !(plan_.config.axis[0].present && plan_.config.axis[1].present))
    missing = {"no signals",
               "needs both x and y; write signal = torque in [monitor.tooth-breakage]"};
  tool_.tooth_breakage_on =
      line(MonitorId::tooth_breakage, section, missing,
           std::string("watches the ") + (force ? "forces of x and y" : "torque") + " of " +
               teeth_up_to());
}

void ToolPlan::pace() {
  // Forces beyond some hundred hertz do not reach these three.
  tool_.half_rate =
      1 / period_ >= kHalfRateFrom_hz && !(tool_.tooth_breakage_on && !tool_.tooth_breakage.torque);
  pace_ = tool_.half_rate ? 2 * period_ : period_;
  for (HostAxisSlotConfig& slot : plan_.config.axis) slot.tool_observer.sample_period_s = pace_;
}

void ToolPlan::drill_fracture() {
  constexpr const char* section = "monitor.drill-fracture";
  DrillFractureConfig& d = tool_.drill_fracture;
  d.sample_period_s = pace_;
  number(section, "threshold_N", d.threshold_N);
  number(section, "drilling_thrust_N", d.drilling_thrust_N);
  number(section, "entry_s", d.entry_s);
  number(section, "average_s", d.average_s);
  number(section, "warning_fraction", d.warning_fraction);
  whole(section, "window_samples", d.window_samples);
  if (tool_.half_rate) d.window_samples = (d.window_samples + 1) / 2;
  if (machine_.text(section, "rotation").value_or("clockwise") == "counter-clockwise")
    d.rotation = Rotation::counter_clockwise;
  // Three turns in the window, as the block wants.
  d.minimum_speed_rad_s = 3 * kTwoPi / (d.window_samples * pace_);
  const double first_s = d.window_samples * pace_ + d.entry_s + d.average_s;
  const double drill_hz =
      std::max(d.window_samples / std::max(0.5, kDrillLatest_s - d.entry_s - d.average_s),
               kDrillAverage / d.average_s);
  const Obstacle missing =
      !spindle_ ? no_spindle()
      : !(plan_.config.axis[0].present && plan_.config.axis[1].present)
          ? Obstacle{"no signals", "needs x and y, each with position and current"}
      : !(d.threshold_N > 0)
          ? Obstacle{"no threshold",
                     "has no threshold; write threshold_N in [monitor.drill-fracture], 1.5 "
                     "times what intact drills show"}
      : 1 / pace_ < drill_hz
          ? Obstacle{"slow signal", "needs at least " + printed(drill_hz) +
                                        " Hz to tell of a hole within " + printed(kDrillLatest_s) +
                                        " s, or fewer window_samples; the signal has " +
                                        printed(1 / pace_) + " Hz"}
          : Obstacle{};
  tool_.drill_fracture_on = line(MonitorId::drill_fracture, section, missing,
                                 "fires on a rotating force of " + printed(d.threshold_N) +
                                     " N from " + printed(rpm_from_rad_s(d.minimum_speed_rad_s)) +
                                     " to " + printed(60 / (kSamplesATurn * pace_)) +
                                     " rpm, first after " + printed(first_s) + " s of a hole");
}

std::optional<std::array<double, 2>> ToolPlan::taught(const char* mean, const char* scatter) const {
  const auto value = machine_.number("monitor.wear", mean);
  if (!value) return {};
  return std::array{*value, machine_.number("monitor.wear", scatter).value_or(0)};
}

void ToolPlan::wear() {
  constexpr const char* section = "monitor.wear";
  WearConfig& w = tool_.wear;
  w.sample_period_s = pace_;
  w.part_s = std::max(w.part_s, 8 * pace_);
  if (plan_.config.axis[2].present)
    w.equivalent_mass_kg = plan_.config.axis[2].observer.drive.inertia;
  if (spindle_) w.inertia_kg_m2 = plan_.config.spindle.observer.drive.inertia;
  if (const auto direction = machine_.number(section, "feed_direction"))
    w.feed_direction = static_cast<int>(*direction);
  for (const auto& [key, to] : {std::pair{"cutting_thrust_N", &w.cutting_thrust_N},
                                std::pair{"cutting_torque_Nm", &w.cutting_torque_Nm},
                                std::pair{"thrust_limit_N", &w.thrust_limit_N},
                                std::pair{"thrust_step_N", &w.thrust_step_N},
                                std::pair{"thrust_ratio", &w.thrust_ratio},
                                std::pair{"torque_limit_Nm", &w.torque_limit_Nm},
                                std::pair{"torque_step_Nm", &w.torque_step_Nm},
                                std::pair{"torque_ratio", &w.torque_ratio},
                                std::pair{"specific_force_ratio", &w.specific_force_ratio},
                                std::pair{"entry_m", &w.entry_m},
                                std::pair{"exit_m", &w.exit_m},
                                std::pair{"shortest_m", &w.shortest_m},
                                std::pair{"clearance_m", &w.clearance_m},
                                std::pair{"peck_window_s", &w.peck_window_s},
                                std::pair{"maximum_feed_m_s", &w.maximum_feed_m_s},
                                std::pair{"minimum_speed_rad_s", &w.minimum_speed_rad_s},
                                std::pair{"friction_error_N", &w.friction_error_N},
                                std::pair{"friction_drift_N", &w.friction_drift_N},
                                std::pair{"friction_noise_N", &w.friction_noise_N},
                                std::pair{"warning_fraction", &w.warning_fraction}})
    number(section, key, *to);
  whole(section, "teach_holes", w.teach_holes);
  whole(section, "average_holes", w.average_holes);
  whole(section, "confirm_holes", w.confirm_holes);
  plan_.taught_thrust_N = taught("taught_thrust_N", "taught_thrust_scatter_N");
  plan_.taught_torque_Nm = taught("taught_torque_Nm", "taught_torque_scatter_Nm");
  const bool holes = judges_holes(w), milling = w.specific_force_ratio > 0;
  const Obstacle missing =
      !spindle_ ? no_spindle()
      : (holes || !milling) && !plan_.config.axis[2].present
          ? Obstacle{"no signals", "needs z, with position and current"}
      : !(holes || milling)
          ? Obstacle{"no threshold",
                     "has no rule; write thrust_limit_N, thrust_step_N or the like in "
                     "[monitor.wear]"}
      : holes && !(w.cutting_thrust_N > 0 || w.cutting_torque_Nm > 0)
          ? Obstacle{"no threshold",
                     "does not know what cutting is; write cutting_thrust_N in [monitor.wear]"}
      : milling && !plan_.coefficients
          ? Obstacle{"no coefficients",
                     "hears of the specific cutting force from the monitor cutting-coefficients, "
                     "which does not run; write [monitor.cutting-coefficients] and what it needs, "
                     "or remove specific_force_ratio"}
          : Obstacle{};
  const std::string of_holes =
      holes ? "compares every hole with the first " + std::to_string(w.teach_holes) : "";
  const std::string of_milling =
      milling ? "follows the specific cutting force, and a worn tool from " +
                    printed(w.specific_force_ratio) + " times that of the new one on"
              : "";
  tool_.wear_on = line(MonitorId::wear, section, missing,
                       of_holes + (holes && milling ? "; " : "") + of_milling);
}

Expected<Done> ToolPlan::torque_band(const StackSignals& signals) {
  const auto lacks = plan_torque_band(machine_, pace_, signals, plan_);
  if (!lacks) return lacks.error();
  tool_.torque_band_on = line(MonitorId::torque_band, "monitor.torque-band", *lacks,
                              torque_band_watches(plan_, signals));
  return Done{};
}

}  // namespace

Expected<Done> plan_tool(const MachineFile& machine, const StackSignals& signals, StackPlan& plan) {
  ToolPlan tool(machine, signals.sample_period_s, plan);
  tool.ar_breakage();
  tool.tooth_breakage();
  tool.pace();
  tool.drill_fracture();
  tool.wear();
  return tool.torque_band(signals);
}

}  // namespace servosense
