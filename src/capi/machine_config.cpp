#include "servosense/capi/machine_config.hpp"

#include <algorithm>
#include <utility>

#include "config_fields.hpp"
#include "servosense/io/drive_columns.hpp"
#include "servosense/observer/machine_config.hpp"

namespace servosense {
namespace {

void drive_from_block(const HostDriveSlotConfig& b, servosense_drive& c,
                      std::vector<servosense_effect>& effects) {
  c.present = b.present ? 1 : 0;
  if (!b.present) return;
  c.motion = static_cast<int>(b.input.kind);
  c.counts_per_turn =
      b.input.unit_per_count != 0 ? b.input.unit_per_turn / b.input.unit_per_count : 0;
  c.counter_bits = b.input.counter_bits;
  const DisturbanceObserverConfig& o = b.observer;
  c.unit_per_turn = o.drive.unit_per_turn;
  c.effort_per_ampere = b.input.effort_per_unit;
  c.effort_update_s = b.input.effort_update_s;
  c.inertia = o.drive.inertia;
  c.viscous_friction = o.drive.viscous;
  c.coulomb_friction = o.drive.coulomb;
  c.constant_load = o.drive.constant_load;
  c.friction_knee = o.drive.friction_knee;
  c.load_inertia_share = o.drive.load_inertia_share;
  c.load_friction_share = o.drive.load_friction_share;
  c.cutoff_rad_s = o.disturbance_cutoff_rad_s;
  c.velocity_cutoff_rad_s = o.velocity_cutoff_rad_s;
  c.monitor_cutoff_rad_s = b.monitor_observer.disturbance_cutoff_rad_s;
  for (std::size_t i = 0; i < o.drive.effects.count; ++i) {
    const EffectSetting& from = o.drive.effects.settings[i];
    servosense_effect to{};
    to.effect = from.effect;
    for (std::size_t p = 0; p < kMaxEffectParameters; ++p) {
      std::copy(from.parameters[p].value.begin(), from.parameters[p].value.end(),
                to.parameters[p].value);
      to.parameters[p].count = from.parameters[p].count;
    }
    effects.push_back(to);
  }
  c.effects = effects.empty() ? nullptr : effects.data();
  c.effect_count = static_cast<std::uint32_t>(effects.size());
}

/// "spindle, x, y and z"
std::string room_of_c() {
  std::string all = "one spindle";
  for (std::size_t i = 0; i < SERVOSENSE_AXES; ++i)
    all += (i + 1 < SERVOSENSE_AXES ? ", " : " and ") + std::string(name_of(axis_channel(i)));
  return all;
}

/// What the file asks for and the controller's stack has no room for; empty when there is none.
std::string no_room(const StackPlan& plan) {
  const HostStackConfig& b = plan.config;
  const auto more = [](const char* what, unsigned asked, unsigned most) {
    return std::string(what) + " of " + std::to_string(asked) + " is more than the " +
           std::to_string(most) + " that the C interface has room for; lower it";
  };
  if (b.spindle.present && b.spindle.chatter_on) {
    const ChatterConfig& chatter = b.spindle.chatter;
    if (chatter.window_revolutions > SERVOSENSE_MAX_REVOLUTIONS)
      return more("window_revolutions in [monitor.chatter]", chatter.window_revolutions,
                  SERVOSENSE_MAX_REVOLUTIONS);
    if (chatter.harmonics > SERVOSENSE_MAX_HARMONICS)
      return more("harmonics in [monitor.chatter]", chatter.harmonics, SERVOSENSE_MAX_HARMONICS);
  }
  const ToolMonitorsConfig& t = b.tool;
  if ((t.ar_breakage_on || t.tooth_breakage_on) && t.ar_breakage.teeth > SERVOSENSE_MAX_TEETH)
    return more("teeth in [tool]", t.ar_breakage.teeth, SERVOSENSE_MAX_TEETH) +
           ", or switch ar-breakage and tooth-breakage off";
  if (plan.coefficients && plan.coefficients->turns.teeth > SERVOSENSE_MAX_TEETH)
    return more("teeth in [tool]", plan.coefficients->turns.teeth, SERVOSENSE_MAX_TEETH) +
           ", or switch cutting-coefficients off";
  return {};
}

}  // namespace

Expected<MachineConfig> machine_config(const MachineFile& machine, const StackSignals& signals) {
  auto plan = plan_stack(machine, signals);
  if (!plan) return plan.error();
  const HostStackConfig& b = plan->config;
  if (const std::string sentence = no_room(*plan); !sentence.empty())
    return data_error(machine.name() + ": " + sentence);
  MachineConfig made;
  servosense_config& c = made.config;
  servosense_default_config(&c);
  c.sample_period_s = signals.sample_period_s;
  capi::all_fields(c, b, capi::kFromBlock);
  // A window that is not watched need not fit.
  c.chatter.window_revolutions =
      std::clamp<std::uint32_t>(c.chatter.window_revolutions, 3, SERVOSENSE_MAX_REVOLUTIONS);
  c.chatter.harmonics = std::min<std::uint32_t>(c.chatter.harmonics, SERVOSENSE_MAX_HARMONICS);
  drive_from_block(b.spindle, c.spindle, made.effects[0]);
  for (std::size_t i = 0; i < SERVOSENSE_AXES; ++i) {
    drive_from_block(b.axis[i], c.axis[i], made.effects[1 + i]);
    if (b.axis[i].present)
      c.axis[i].tool_cutoff_rad_s = b.axis[i].tool_observer.disturbance_cutoff_rad_s;
  }
  const ColumnChoices choices = column_choices(machine);
  const auto of_the_drive = [&](Channel channel, const HostDriveSlotConfig& slot,
                                servosense_drive& to) {
    if (!slot.present) return;
    const DriveSignal& reported = *signals.drive(channel);
    if (reported.effort == EffortKind::current_A) {
      to.torque_constant_per_K = choices.drive(channel).constant.per_K;
      to.torque_constant_at_C = choices.drive(channel).constant.at_C;
    }
    to.estimate_noise = estimate_noise(machine, channel, slot.observer.disturbance_cutoff_rad_s);
  };
  of_the_drive(plan->tool_spindle, b.spindle, c.spindle);
  for (std::size_t i = 0; i < SERVOSENSE_AXES; ++i)
    of_the_drive(axis_channel(i), b.axis[i], c.axis[i]);
  if (plan->follow) {
    c.friction.enabled = 1;
    capi::friction_fields(c.friction, *plan->follow, capi::kFromBlock);
  }
  const unsigned teeth =
      plan->coefficients ? plan->coefficients->turns.teeth : b.tool.ar_breakage.teeth;
  c.teeth = teeth <= SERVOSENSE_MAX_TEETH ? teeth : 0;
  c.drill_fracture.counter_clockwise =
      b.tool.drill_fracture.rotation == Rotation::counter_clockwise ? 1 : 0;
  if (plan->taught_thrust_N) {
    c.wear.taught_thrust_N = (*plan->taught_thrust_N)[0];
    c.wear.taught_thrust_scatter_N = (*plan->taught_thrust_N)[1];
  }
  if (plan->taught_torque_Nm) {
    c.wear.taught_torque_Nm = (*plan->taught_torque_Nm)[0];
    c.wear.taught_torque_scatter_Nm = (*plan->taught_torque_Nm)[1];
  }
  if (plan->coefficients) {
    c.coefficients.enabled = 1;
    capi::all_coefficients(c.coefficients, *plan->coefficients, capi::kFromBlock);
  }
  for (const TorqueBandPoint<double>& p : plan->torque_band)
    made.reference.push_back({static_cast<float>(p.torque_Nm), static_cast<float>(p.lower_Nm),
                              static_cast<float>(p.upper_Nm), static_cast<float>(p.feed)});
  c.torque_band.reference = made.reference.empty() ? nullptr : made.reference.data();
  c.torque_band.reference_count = static_cast<std::uint32_t>(made.reference.size());
  for (const TorqueBandSection<double>& s : plan->torque_band_sections)
    made.sections.push_back(
        {s.first, s.block, static_cast<float>(s.speed_rad_s), static_cast<std::uint8_t>(s.has_air),
         static_cast<std::uint8_t>(s.behind_gap), static_cast<float>(s.air_Nm)});
  c.torque_band.sections = made.sections.empty() ? nullptr : made.sections.data();
  c.torque_band.section_count = static_cast<std::uint32_t>(made.sections.size());
  c.grouped = plan->grouped ? 1 : 0;
  made.monitors = std::move(plan->monitors);
  made.remarks = std::move(plan->remarks);
  for (const Channel channel : kDriveChannels) {
    if (machine.flag(section_of(channel), "gantry").value_or(false))
      made.remarks.push_back("[" + std::string(section_of(channel)) +
                             "] is a gantry: tell its stack the sum of both motors' efforts");
    if (effort_share(machine, channel).share != 1)
      made.remarks.push_back("[" + std::string(section_of(channel)) +
                             "] effort_share is in the constant of a current; divide a torque or "
                             "force by it before the stack is told");
    if (machine.flag(section_of(channel), "current_is_unsigned").value_or(false))
      made.remarks.push_back("[" + std::string(section_of(channel)) +
                             "] current_is_unsigned is not carried over: the blocks take a current "
                             "with a sign");
    const bool room =
        is_spindle(channel) ? channel == plan->tool_spindle : axis_index(channel) < SERVOSENSE_AXES;
    if (room || !machine.has_section(section_of(channel))) continue;
    const std::string section(section_of(channel));
    made.remarks.push_back("[" + section + "] is not carried over: the C interface has room for " +
                           room_of_c());
    for (MonitorAvailability& m : made.monitors)
      if (m.channel == channel)
        m.reason = "the C interface has room for the monitors of " + room_of_c();
  }
  return made;
}

Expected<StackSignals> signals_of_file(const MachineFile& machine) {
  StackSignals signals;
  const auto rate = machine.number("machine", "sample_rate_hz");
  if (!rate)
    return data_error(
        machine.name() +
        ": needs sample_rate_hz in [machine]; write the servo rate of the controller");
  signals.sample_period_s = 1 / *rate;
  const auto reported = [&](const std::string& section, EffortKind without_constant) {
    DriveSignal signal;
    signal.motion =
        machine.has(section, "encoder_counts_per_rev") ? MotionKind::counts : MotionKind::position;
    const bool current = machine.has(section, "torque_constant_Nm_per_A") ||
                         machine.has(section, "force_constant_N_per_A");
    signal.effort = current ? EffortKind::current_A : without_constant;
    return signal;
  };
  const std::string spindle(name_of(tool_spindle(machine)));
  if (machine.has_section(spindle))
    signals.drive(tool_spindle(machine)) = reported(spindle, EffortKind::torque_Nm);
  for (std::size_t i = 0; i < SERVOSENSE_AXES; ++i) {
    const Channel axis = axis_channel(i);
    const std::string section(section_of(axis));
    if (machine.has_section(section))
      signals.axis[i] =
          reported(section, is_turning(axis) ? EffortKind::torque_Nm : EffortKind::force_N);
  }
  return signals;
}

}  // namespace servosense
