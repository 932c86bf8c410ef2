// The machine file after `servosense identify idle`, from samples at hand.
#pragma once

#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "servosense/core/servo_sample.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/identify/learn_thresholds.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace detection {

using namespace servosense;

/// What the idle run of an axis taught, as `identify idle` writes it.
inline void set_collision_thresholds(MachineFile& machine, const std::string& axis,
                                     const auto& learned) {
  machine.set("monitor.collision", "threshold_" + axis + "_N_per_s", learned.threshold());
  std::vector<double> phases;
  for (const auto phase : {MotionPhase::standstill, MotionPhase::constant_speed,
                           MotionPhase::acceleration, MotionPhase::reversal})
    phases.push_back(learned.phase_threshold(phase));
  machine.set("monitor.collision", "phase_thresholds_" + axis + "_N_per_s",
              std::span<const double>(phases));
}

template <typename T>
T good(Expected<T> result, const char* what) {
  if (!result) {
    std::printf("%s: %s\n", what, result.error().sentence.c_str());
    std::exit(1);
  }
  return *std::move(result);
}

/// Inertia and friction as found, thresholds and noise as learned, of every drive in `signals`.
/// `next()` gives the samples of the idling run in turn, `teeth` of the tool (0: none).
template <typename Next>
[[nodiscard]] MachineFile learn_idle(MachineFile machine, const StackSignals& signals,
                                     unsigned teeth, std::size_t samples, Next&& next,
                                     const char* what) {
  const StackPlan plan = good(plan_stack(machine, signals), what);
  struct Drive {
    HostDriveSlotConfig slot;
    DriveRecord record;
    DriveInput<double> input;
  };
  std::vector<Drive> drives;
  const auto add = [&](Channel channel, const HostDriveSlotConfig& slot) {
    Drive& d = drives.emplace_back();
    d.slot = slot;
    d.record.channel = channel;
    d.record.sample_period_s = signals.sample_period_s;
    d.record.samples.reserve(samples);
    d.input.configure(slot.input);
  };
  if (signals.spindle) add(Channel::spindle, plan.config.spindle);
  for (std::size_t i = 0; i < kAxes; ++i)
    if (signals.axis[i]) add(axis_channel(i), plan.config.axis[i]);
  const auto axis_of = [](Channel c) {
    return static_cast<std::size_t>(c) - static_cast<std::size_t>(Channel::x);
  };
  for (std::size_t i = 0; i < samples; ++i) {
    const ServoSample<double> s = next();
    for (Drive& d : drives)
      d.record.samples.push_back(d.input.process(
          d.record.channel == Channel::spindle ? s.spindle : s.axis[axis_of(d.record.channel)]));
  }
  for (const Drive& d : drives) {
    const bool spindle = d.record.channel == Channel::spindle;
    IdleOptions options;  // the knee is in the file, and stays
    options.knees = {d.slot.observer.drive.friction_knee};
    const IdleIdentification found = good(identify_idle(d.slot.observer, d.record, options), what);
    DisturbanceObserverConfig watching = d.slot.monitor_observer;
    watching.drive = identified_drive(d.slot.observer.drive, found);
    const std::string name{servosense::name_of(d.record.channel)};
    const std::string section = spindle ? "spindle" : "axis." + name;
    machine.set(section, spindle ? "inertia_kg_m2" : "equivalent_mass_kg", found.inertia.value);
    machine.set(section, spindle ? "viscous_friction_Nm_s_per_rad" : "viscous_friction_N_s_per_m",
                found.viscous.value);
    machine.set(section, spindle ? "coulomb_friction_Nm" : "coulomb_friction_N",
                found.coulomb.value);
    if (!spindle) {
      const auto jerk = learn_collision(
          watching, plan.config.axis[axis_of(d.record.channel)].collision, d.record);
      set_collision_thresholds(machine, name, jerk);
      continue;
    }
    machine.set("monitor.chatter", "chatter_threshold_Nm2",
                learn_chatter(watching, plan.config.spindle.chatter, d.record).threshold());
    machine.set("monitor.collision", "cutting_torque_Nm",
                learn_cutting_torque(watching, plan.config.cut, d.record));
    if (teeth < 2) continue;
    const ToothNoise noise = learn_tooth_noise(watching, teeth, d.record);
    machine.set("monitor.ar-breakage", "noise_Nm", noise.tooth.sigma());
    machine.set("monitor.tooth-breakage", "noise_Nm", noise.tooth.sigma());
    machine.set("monitor.tooth-breakage", "sample_noise_Nm", noise.sample.sigma());
  }
  return machine;
}

}  // namespace detection
