#include "servosense/capi/machine_file.h"

#include <algorithm>
#include <exception>
#include <string>

#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace {

using namespace servosense;

void fill(const DriveSlotConfig& from, servosense_drive& to) {
  to.present = from.present ? 1 : 0;
  if (!from.present) return;
  to.motion = static_cast<int>(from.input.kind);
  to.counts_per_turn =
      from.input.unit_per_count != 0 ? from.input.unit_per_turn / from.input.unit_per_count : 0;
  to.counter_bits = from.input.counter_bits;
  to.unit_per_turn = from.input.unit_per_turn;
  to.effort_per_ampere = from.input.effort_per_unit;
  to.inertia = from.observer.drive.inertia;
  to.viscous_friction = from.observer.drive.viscous;
  to.coulomb_friction = from.observer.drive.coulomb;
  to.constant_load = from.observer.drive.constant_load;
  to.cutoff_rad_s = from.observer.disturbance_cutoff_rad_s;
  to.monitor_cutoff_rad_s = from.monitor_observer.disturbance_cutoff_rad_s;
}

Expected<servosense_config> config_from(const char* path, const servosense_signals& reported) {
  auto machine = MachineFile::read(path);
  if (!machine) return machine.error();
  StackSignals signals;
  signals.sample_period_s = reported.sample_period_s;
  for (int i = 0; i <= SERVOSENSE_AXES; ++i) {
    if (reported.motion[i] < 0) continue;
    if (reported.motion[i] > SERVOSENSE_VELOCITY)
      return usage_error("a drive's motion must be counts, position or velocity");
    const DriveSignal signal{static_cast<MotionKind>(reported.motion[i]),
                             reported.current[i] != 0 ? EffortKind::current_A
                             : i == 0                 ? EffortKind::torque_Nm
                                                      : EffortKind::force_N};
    if (i == 0)
      signals.spindle = signal;
    else
      signals.axis[static_cast<std::size_t>(i - 1)] = signal;
  }
  auto plan = plan_stack(*machine, signals);
  if (!plan) return plan.error();
  servosense_config c;
  servosense_default_config(&c);
  c.sample_period_s = reported.sample_period_s;
  fill(plan->config.spindle, c.spindle);
  const ChatterConfig& chatter = plan->config.spindle.chatter;
  c.window_revolutions = std::min(chatter.window_revolutions, 8U);
  const bool listens = plan->config.spindle.chatter_on;
  c.chatter_threshold_Nm2 = listens ? chatter.chatter_threshold_Nm2 : SERVOSENSE_OFF;
  c.forced_threshold_Nm2 = chatter.forced_threshold_Nm2;
  for (std::size_t i = 0; i < kAxes; ++i) {
    fill(plan->config.axis[i], c.axis[i]);
    const AxisSlotConfig& axis = plan->config.axis[i];
    c.collision_threshold_N_per_s[i] =
        axis.collision_on ? axis.collision.threshold_N_per_s : SERVOSENSE_OFF;
  }
  const ToolMonitorsConfig& tool = plan->config.tool;
  const unsigned teeth = tool.ar_breakage.teeth;
  c.teeth = teeth >= 2 && teeth <= 8 ? teeth : 0;
  if (c.teeth > 0 && tool.ar_breakage_on) c.ar_noise_Nm = tool.ar_breakage.noise_Nm;
  if (c.teeth > 0 && tool.tooth_breakage_on && tool.tooth_breakage.torque) {
    c.tooth_noise_Nm = tool.tooth_breakage.noise;
    c.tooth_sample_noise_Nm = tool.tooth_breakage.sample_noise;
  }
  return c;
}

void copy(const std::string& sentence, char* error, size_t bytes) {
  if (error == nullptr || bytes == 0) return;
  const size_t n = std::min(sentence.size(), bytes - 1);
  sentence.copy(error, n);
  error[n] = '\0';
}

}  // namespace

extern "C" int servosense_config_from_file(const char* path, const servosense_signals* signals,
                                           servosense_config* config, char* error,
                                           size_t error_bytes) {
  if (path == nullptr || signals == nullptr || config == nullptr) {
    copy("path, signals and configuration must be given", error, error_bytes);
    return -1;
  }
  try {
    auto filled = config_from(path, *signals);
    if (!filled) {
      copy(filled.error().sentence, error, error_bytes);
      return -1;
    }
    *config = *filled;
    return 0;
  } catch (const std::exception& e) {  // out of memory: nothing may cross the line
    copy(e.what(), error, error_bytes);
    return -1;
  }
}
