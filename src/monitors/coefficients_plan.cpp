#include "coefficients_plan.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "servosense/core/units.hpp"
#include "servosense/io/coefficient_file.hpp"
#include "servosense/io/text.hpp"
#include "servosense/model/average_cutting.hpp"
#include "servosense/monitors/cutting_coefficients.hpp"

namespace servosense {
namespace {

constexpr const char* kCoefficientsSection = "monitor.cutting-coefficients";
// Chosen: tables of coefficients differ by so much for one material, and friction by so much from
// day to day.
constexpr double kCoefficientsError = 0.3, kFrictionError = 0.1;
// Where the radial ratio is not told: steel has 0.2 to 0.5. And an edge that the file leaves out
// pushes as 10 um of chip do, at most.
constexpr double kUsualRadial = 0.3, kRadialError = 0.2, kEdgeChip_m = 10e-6;
// That of every threshold that is learned.
constexpr double kFalseAlarms_per_hour = 0.01;
constexpr double kUsualSpeed_rpm = 6000;
constexpr double kRapid = 5;  // times the feed per tooth of [cut], and more, is no cut

constexpr double kRunout_m = 5e-6;  // CuttingCoefficients: its errors hold so much

/// Half of how far apart the teeth reach.
double runout_of(const std::vector<double>& throw_m) {
  if (throw_m.empty()) return 0;
  const auto [low, high] = std::ranges::minmax(throw_m);
  return (high - low) / 2;
}

Expected<MillingTool> tool_of(const MachineFile& machine) {
  MillingTool tool;
  tool.diameter_m = machine.number("tool", "diameter_m").value_or(0);
  tool.teeth = static_cast<int>(machine.number("tool", "teeth").value_or(1));
  tool.throw_m = machine.list("tool", "throw_m").value_or(std::vector<double>{});
  if (!tool.throw_m.empty() && static_cast<int>(tool.throw_m.size()) != tool.teeth)
    return data_error(machine.where("tool") + ": [tool] throw_m needs one number for each of the " +
                      std::to_string(tool.teeth) + " teeth");
  add_offset(tool, machine.number("tool", "runout_m").value_or(0), 0);
  return tool;
}

/// `feed_per_tooth_m`: at which teeth that run out pass over their chip.
CuttingShares shares_of(const MillingTool& tool, double depth_m, const Engagement& engagement,
                        double feed_per_tooth_m) {
  const AverageCutting chip = average_cutting(tool.teeth, tool.radius_m(), depth_m, 1, engagement);
  const AverageCutting edge = average_cutting(tool.teeth, tool.radius_m(), depth_m,
                                              feed_per_tooth_m, engagement, tool.throw_m);
  return {chip.torque.tangential, edge.torque.tangential_edge,
          chip.x.tangential,      edge.x.tangential_edge,
          chip.x.radial,          edge.x.radial_edge,
          chip.y.tangential,      edge.y.tangential_edge,
          chip.y.radial,          edge.y.radial_edge};
}

/// What it needs and the file or the record does not have; empty when nothing is missing.
MonitorAvailability missing(const MachineFile& machine, const StackPlan& plan) {
  MonitorAvailability m{MonitorId::cutting_coefficients, Channel::tool, false, "", ""};
  const auto lacks = [&](const char* word, const std::string& sentence) {
    m.obstacle = word;
    m.reason = sentence;
  };
  if (!machine.flag(kCoefficientsSection, "enabled").value_or(true)) {
    lacks("switched off", "switched off in the machine file");
    return m;
  }
  for (const char* key : {"diameter_m", "teeth", "tangential_coefficient_N_per_m2"})
    if (!machine.has("tool", key)) {
      lacks("no tool", std::string("needs the tool and what is known of its coefficients; write ") +
                           key + " in [tool]");
      return m;
    }
  const bool slot = machine.text("cut", "direction").value_or("down") == "slot";
  for (const char* key : {"feed_per_tooth_m", "axial_depth_m", "radial_immersion_m"})
    if (!machine.has("cut", key) && !(slot && std::string(key) == "radial_immersion_m")) {
      lacks("no engagement",
            std::string("needs the engagement of every cut; write ") + key + " in [cut]");
      return m;
    }
  if (!plan.config.spindle.present)
    lacks("no signals", "needs the spindle's angle or speed and its current or torque");
  else if (!plan.config.axis[0].present || !plan.config.axis[1].present)
    lacks(
        "no signals",
        "needs position or velocity and current, torque or force of x and y, which tell the feed");
  else if (machine.flag(name_of(plan.tool_spindle), "current_is_ratio").value_or(false))
    lacks("no scale", "needs a torque in Nm, and no scale is published for the spindle's current");
  else if (!(plan.config.cut.torque_Nm > 0))
    lacks("no threshold",
          "does not know which torque means cutting; run 'servosense identify idle' or write "
          "cutting_torque_Nm in [monitor.collision]");
  return m;
}

}  // namespace

Expected<Done> plan_coefficients(const MachineFile& file, double period, StackPlan& plan) {
  if (!file.has_section(kCoefficientsSection)) return Done{};
  const auto joined = with_coefficients(file);
  if (!joined) return joined.error();
  const MachineFile& machine = *joined;
  MonitorAvailability& m = plan.monitors.emplace_back(missing(machine, plan));
  if (!m.obstacle.empty()) return Done{};
  const auto tool_number = [&](const char* key, double otherwise) {
    return machine.number("tool", key).value_or(otherwise);
  };
  const auto number = [&](const char* key, double otherwise) {
    return machine.number(kCoefficientsSection, key).value_or(otherwise);
  };

  CuttingCoefficientsConfig c;
  const auto of_file = tool_of(machine);
  if (!of_file) return of_file.error();
  const MillingTool& tool = *of_file;
  MillingCut cut;
  cut.axial_depth_m = machine.number("cut", "axial_depth_m").value_or(0);
  cut.radial_immersion_m = machine.number("cut", "radial_immersion_m").value_or(0);
  const std::string direction = machine.text("cut", "direction").value_or("down");
  cut.direction = direction == "slot" ? MillingDirection::slot
                  : direction == "up" ? MillingDirection::up
                                      : MillingDirection::down;
  c.feed_per_tooth_m = machine.number("cut", "feed_per_tooth_m").value_or(0);
  c.shares = shares_of(tool, cut.axial_depth_m, engagement_of(tool, cut), c.feed_per_tooth_m);
  const double share = number("coefficients_error", kCoefficientsError);
  const double chip = tool_number("tangential_coefficient_N_per_m2", 0);
  const auto told = [&](double value, double otherwise) {
    return ToldCoefficient{value, value > 0 ? share * value : otherwise};
  };
  c.tangential = told(chip, 0);
  c.tangential_edge = told(tool_number("tangential_edge_N_per_m", 0), kEdgeChip_m * chip);
  c.radial = machine.has("tool", "radial_ratio")
                 ? told(tool_number("radial_ratio", 0) * chip, kRadialError * chip)
                 : ToldCoefficient{kUsualRadial * chip, kRadialError * chip};
  c.radial_edge = told(tool_number("radial_edge_N_per_m", 0), kEdgeChip_m * chip);

  const double speed_rpm = machine.number("cut", "spindle_speed_rpm").value_or(kUsualSpeed_rpm);
  const double feed_m_s = speed_rpm / 60 * tool.teeth * c.feed_per_tooth_m;
  const double friction = number("friction_error", kFrictionError);
  const auto friction_error = [&](const HostDriveSlotConfig& slot, double speed) {
    return friction * (slot.observer.drive.coulomb + slot.observer.drive.viscous * speed);
  };
  c.torque_friction_error_Nm = friction_error(plan.config.spindle, rad_s_from_rpm(speed_rpm));
  for (std::size_t i = 0; i < 2; ++i)
    c.force_friction_error_N[i] = friction_error(plan.config.axis[i], feed_m_s);

  c.turns.sample_period_s = period;
  c.turns.cutting_torque_Nm = plan.config.cut.torque_Nm;
  c.turns.radius_m = tool.radius_m();
  c.turns.teeth = static_cast<unsigned>(tool.teeth);
  c.turns.most_feed_per_tooth_m = kRapid * c.feed_per_tooth_m;
  c.turns.least_feed_per_tooth_m =
      std::min(c.turns.least_feed_per_tooth_m, c.feed_per_tooth_m / 10);
  c.turns.minimum_speed_rad_s = std::min(c.turns.minimum_speed_rad_s, 0.5 / period);
  // The slowest filter that torque or force have gone through, six times its time constant.
  double slowest = 2 * kTwoPi / c.turns.settle_s;
  for (const HostDriveSlotConfig* slot : {static_cast<HostDriveSlotConfig*>(&plan.config.spindle),
                                          static_cast<HostDriveSlotConfig*>(&plan.config.axis[0]),
                                          static_cast<HostDriveSlotConfig*>(&plan.config.axis[1])})
    slowest = std::min(
        {slowest, slot->observer.disturbance_cutoff_rad_s, slot->observer.velocity_cutoff_rad_s});
  if (const auto filter = machine.number(name_of(plan.tool_spindle), "current_filter_hz"))
    slowest = std::min(slowest, kTwoPi * *filter);
  c.turns.settle_s = 6 / slowest;

  c.smallest_change = number("smallest_change", c.smallest_change);
  const double rate = number("false_alarm_rate_per_hour", kFalseAlarms_per_hour);
  c.false_change_slots = std::max(60 * speed_rpm / std::max(rate, 1e-9), 100.0);
  c.teach_slots = static_cast<unsigned>(number("teach_slots", c.teach_slots));
  c.taught_N_per_m2 = number("taught_N_per_m2", 0);
  c.chip_m = number("chip_m", 0);
  if (const Status s = CuttingCoefficients<double>::validate(c); !s.ok())
    return data_error(machine.where(kCoefficientsSection) + ": [" + kCoefficientsSection +
                      "]: " + s.parameter() + " " + s.reason());
  m.runs = true;
  m.reason = "follows the specific cutting force of cuts " + printed(1e3 * cut.axial_depth_m) +
             " mm deep as [cut] says, in revolutions from " + printed(c.turns.cutting_torque_Nm) +
             " Nm on, and changes of it";
  if (const double runout = runout_of(tool.throw_m); runout > kRunout_m)
    m.reason += "; its errors hold run-out up to " + printed(1e6 * kRunout_m) + " um, [tool] has " +
                printed(1e6 * runout) + " um";
  plan.coefficients = c;
  return Done{};
}

Expected<Done> plan_engagements(const MachineFile& machine, StackPlan& plan) {
  if (!plan.coefficients || !plan.config.tool.torque_band_on || plan.engagements.empty())
    return Done{};
  const auto tool = tool_of(machine);
  if (!tool) return tool.error();
  for (const PredictedEngagement& e : plan.engagements)
    plan.engagement_shares.push_back(shares_of(*tool, e.axial_depth_m, {e.start_rad, e.exit_rad},
                                               plan.coefficients->feed_per_tooth_m));
  for (MonitorAvailability& m : plan.monitors)
    if (m.monitor == MonitorId::cutting_coefficients)
      m.reason = "follows the specific cutting force of the " +
                 std::to_string(plan.engagements.size()) +
                 " engagements of the program, where one of them lasts, in revolutions from " +
                 printed(plan.coefficients->turns.cutting_torque_Nm) + " Nm on, and changes of it";
  return Done{};
}

}  // namespace servosense
