#include "servosense/monitors/stack_config.hpp"

#include <algorithm>
#include <string_view>

#include "coefficients_plan.hpp"
#include "drive_plan.hpp"
#include "obstacle.hpp"
#include "servosense/io/machine_keys.hpp"
#include "servosense/io/text.hpp"
#include "stack_refusal.hpp"
#include "tool_plan.hpp"

namespace servosense {
namespace {

/// The sentence for a drive whose signals the machine file cannot scale; empty when it can.
std::string unusable(const MachineFile& machine, Channel channel, DriveSignal signal) {
  const std::string section(section_of(channel));
  const bool linear = is_linear_axis(channel);
  if (!machine.has_section(section))
    return "the trace has this drive but " + machine.name() + " has no section [" + section +
           "]; add it";
  if (signal.motion == MotionKind::counts && !machine.has(section, "encoder_counts_per_rev"))
    return machine.where(section) + ": [" + section +
           "] needs encoder_counts_per_rev to read the encoder counts of the trace";
  if (linear && signal.motion == MotionKind::counts && !machine.has(section, "lead_m"))
    return machine.where(section) + ": [" + section +
           "] needs lead_m to turn encoder counts into metres";
  if (linear && signal.effort == EffortKind::torque_Nm && !machine.has(section, "lead_m"))
    return machine.where(section) + ": [" + section +
           "] needs lead_m to turn the motor torque of the trace into a force";
  if (signal.effort == EffortKind::current_A && !machine.has(section, "torque_constant_Nm_per_A") &&
      !(linear && machine.has(section, "force_constant_N_per_A")))
    return machine.where(section) + ": [" + section +
           "] needs torque_constant_Nm_per_A to turn the current of the trace into a torque";
  return {};
}

CutDetectorConfig cut_config(double period) {
  CutDetectorConfig cut;
  cut.sample_period_s = period;
  cut.cutoff_rad_s = std::min(cut.cutoff_rad_s, 0.05 / period);
  return cut;
}
// The monitors hear of groups of samples, where the rate and what runs allow.
void plan_groups(StackPlan& plan, double period) {
  const ToolMonitorsConfig& tool = plan.config.tool;
  const char* against = 1 / period < kHalfRateFrom_hz ? "the signal is slower than 8 kHz"
                        : tool.tooth_breakage_on && !tool.tooth_breakage.torque
                            ? "tooth breakage watches the forces of x and y"
                            : nullptr;
  if (against != nullptr) {
    plan.remarks.push_back(std::string("grouped_monitors is not used: ") + against);
    return;
  }
  plan.grouped = true;
  plan.remarks.push_back(
      "monitors hear of 2 samples of the spindle and of 4 of an axis as of one: chatter up to " +
      printed(0.25 / period) + " Hz");
}

/// Of a spindle whose friction the file has followed.
void plan_follower(const MachineFile& machine, double period, StackPlan& plan) {
  constexpr const char* kSection = "observer.spindle";
  const auto share = machine.number(kSection, "follow_friction_share");
  if (!share || plan.slot_of(Channel::spindle) == nullptr) return;
  const std::string name = machine.where(kSection) + ": follow_friction_share ";
  if (plan.tool_spindle != Channel::spindle) {
    plan.remarks.push_back(name +
                           "is not used: the tool is on the other spindle, and its torque alone "
                           "tells a cut from the air");
    return;
  }
  const DriveModelConfig& drive = plan.config.spindle.observer.drive;
  FrictionFollowerConfig follow;
  follow.sample_period_s = period;
  follow.viscous = drive.viscous;
  follow.coulomb = drive.coulomb;
  follow.share = *share;
  follow.cutting_torque_Nm = plan.config.cut.torque_Nm;
  if (!(follow.cutting_torque_Nm > 0)) {
    plan.remarks.push_back(name +
                           "is not used: [monitor.collision] lacks cutting_torque_Nm, which tells "
                           "a cut from the air; run 'servosense identify idle' on an idling run");
    return;
  }
  for (const char* shared : {"backlash", "flexible-coupling"})
    if (drive.effects.find(shared) != nullptr) {
      plan.remarks.push_back(name + "is not used: the effect " + shared +
                             " shares the friction out between motor and load");
      return;
    }
  if (const Status s = FrictionFollower<double>::validate(follow); !s.ok()) {
    plan.remarks.push_back(name + "is not used: " + s.parameter() + " " + s.reason());
    return;
  }
  FrictionFollower<double> follower;
  follower.configure(follow);
  plan.follow = follow;
  plan.remarks.push_back("spindle: friction is followed as it warms up, by up to " +
                         printed(100 * follow.share) +
                         " % of the machine file's; of a cut, at most " +
                         printed(follower.gate_Nm()) + " Nm is taken for friction");
}

/// What the file holds for others: simulators and reconcile know more effects than observers do.
void say_unused(const MachineFile& machine, StackPlan& plan) {
  constexpr std::string_view kPrefix = "effect.";
  for (const std::string& section : machine.sections()) {
    if (!section.starts_with(kPrefix)) continue;
    const std::size_t dot = section.find('.', kPrefix.size());
    const auto channel = channel_from(section.substr(kPrefix.size(), dot - kPrefix.size()));
    if (!channel || !is_drive(*channel) ||
        drive_effect_index(section.substr(dot + 1)) == kDriveEffectCount)
      plan.remarks.push_back("[" + section +
                             "] is not used: no monitor's model has such an effect");
  }
}

}  // namespace

const HostDriveSlotConfig* StackPlan::slot_of(Channel drive) const {
  if (drive == other_spindle(tool_spindle) && !second) return nullptr;
  const HostDriveSlotConfig& slot =
      is_spindle(drive) ? static_cast<const HostDriveSlotConfig&>(stack_of(drive).spindle)
                        : config.axis[axis_index(drive)];
  return slot.present ? &slot : nullptr;
}

Expected<StackPlan> plan_stack(const MachineFile& machine, const StackSignals& signals) {
  StackPlan plan;
  plan.tool_spindle = tool_spindle(machine);
  const double period = signals.sample_period_s;
  std::string first_obstacle;
  bool any = false;  // in the first stack
  auto obstacle = [&](MonitorId monitor, Channel channel, const std::string& reason) {
    if (first_obstacle.empty()) first_obstacle = reason;
    plan.monitors.push_back({monitor, channel, false, reason, "incomplete machine file"});
  };
  plan.config.cut.unseen = machine.has_section(name_of(plan.tool_spindle));
  const auto reports_nothing = [&](MonitorId monitor, Channel channel) {
    // A machine has a spindle and x, y, z; of the others the file tells.
    const bool usual = channel == plan.tool_spindle || is_linear_axis(channel);
    if (!usual && !machine.has_section(section_of(channel))) return;
    const Obstacle missing = is_spindle(channel) ? no_spindle() : no_axis(channel);
    plan.monitors.push_back({monitor, channel, false, missing.sentence, missing.word});
  };
  /// Whether it can be heard, and is planned.
  const auto hears_spindle = [&](Channel channel) -> Expected<bool> {
    const std::optional<DriveSignal>& signal = signals.drive(channel);
    if (!signal) {
      reports_nothing(MonitorId::chatter, channel);
      return false;
    }
    if (const std::string why = unusable(machine, channel, *signal); !why.empty()) {
      obstacle(MonitorId::chatter, channel, why);
      return false;
    }
    if (channel == plan.tool_spindle) {
      CutDetectorConfig& cut = plan.config.cut;
      cut = cut_config(period);
      cut.torque_Nm = machine.number("monitor.collision", "cutting_torque_Nm").value_or(0);
      cut.load_cutoff_rad_s = own_cutoffs(machine, "monitor.collision", kCollisionCutoff_rad_s)
                                  .disturbance_cutoff_rad_s;
    }
    if (auto done = plan_spindle(machine, channel, *signal, period, plan); !done)
      return done.error();
    return true;
  };
  const auto of_tool = hears_spindle(plan.tool_spindle);
  if (!of_tool) return of_tool.error();
  any = *of_tool;
  for (std::size_t i = 0; i < kAllAxes; ++i) {
    const Channel channel = axis_channel(i);
    if (!signals.axis[i]) {
      reports_nothing(MonitorId::collision, channel);
      continue;
    }
    if (const std::string why = unusable(machine, channel, *signals.axis[i]); !why.empty()) {
      obstacle(MonitorId::collision, channel, why);
      continue;
    }
    if (auto done = plan_axis(machine, channel, *signals.axis[i], period, plan); !done)
      return done.error();
    any = true;
  }
  const auto of_other = hears_spindle(other_spindle(plan.tool_spindle));
  if (!of_other) return of_other.error();
  if (plan.second) plan.second->cut = cut_config(period);
  if (!any && !plan.second)
    return data_error(first_obstacle.empty() ? "no drive has both motion and effort"
                                             : first_obstacle);
  if (auto done = plan_coefficients(machine, period, plan); !done) return done.error();
  if (auto done = plan_tool(machine, signals, plan); !done) return done.error();
  if (auto done = plan_engagements(machine, plan); !done) return done.error();
  plan_follower(machine, period, plan);
  if (machine.flag("machine", "grouped_monitors").value_or(false)) plan_groups(plan, period);
  const auto accept = [&](const HostStackConfig& config, Channel spindle) {
    return accepted(machine, plan.grouped ? in_groups(config) : config, spindle);
  };
  if (any)
    if (auto done = accept(plan.config, plan.tool_spindle); !done) return done.error();
  if (plan.second)
    if (auto done = accept(*plan.second, other_spindle(plan.tool_spindle)); !done)
      return done.error();
  say_unused(machine, plan);
  return plan;
}

void prepare(HostStack& stack, const StackPlan& plan) {
  stack.configure(plan.grouped ? in_groups(plan.config) : plan.config);
  if (plan.taught_thrust_N || plan.taught_torque_Nm) {
    const auto thrust = plan.taught_thrust_N.value_or(std::array<double, 2>{});
    const auto torque = plan.taught_torque_Nm.value_or(std::array<double, 2>{});
    stack.tool().wear().set_taught(thrust[0], thrust[1], torque[0], torque[1]);
  }
  if (plan.torque_band.empty()) return;
  stack.tool().torque_band().set_reference(
      TorqueBandView<double>{plan.torque_band, plan.torque_band_sections, plan.expected_cuts,
                             plan.torque_band_changes, plan.tooth_lines});
  stack.tool().torque_band().start();
}

}  // namespace servosense
