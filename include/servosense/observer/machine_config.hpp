// From the machine file to the configuration of drives and observers.
#pragma once

#include <string>
#include <utility>
#include <variant>

#include "servosense/core/channel.hpp"
#include "servosense/core/drive_input.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/observer/drive_config.hpp"

namespace servosense {

/// Reads [spindle], [observer.spindle] and [effect.spindle.*], or those of another drive that turns
/// (spindle2, a, b, c). With a gear_ratio, counts and torque constant are those of a turn of the
/// spindle or table. Missing numbers keep their defaults
/// (no inertia, no friction), so a machine that is yet to be identified can be read. Data error
/// naming the section for what no block accepts.
Expected<SpindleConfig> spindle_config(const MachineFile& machine,
                                       Channel channel = Channel::spindle);

/// The same for [axis.x], [axis.y] or [axis.z]; the lead is that of a turn of the motor.
/// The spindle that turns the tool, or the work that it cuts: [tool] spindle, or else the first.
[[nodiscard]] Channel tool_spindle(const MachineFile& machine);

Expected<AxisConfig> axis_config(const MachineFile& machine, Channel axis);

/// A drive of either kind, in its own units: rad, Nm and kg m2 where it turns, else m, N and kg.
class DriveConfig {
 public:
  explicit DriveConfig(const SpindleConfig& turning) : drive_(turning) {}
  explicit DriveConfig(const AxisConfig& linear) : drive_(linear) {}

  /// What the drive reports; at first a current.
  void reports(EffortKind effort) {
    std::visit([&](auto& d) { d.effort_is_current = effort == EffortKind::current_A; }, drive_);
  }
  [[nodiscard]] DriveInputConfig input(DriveSignal signal, double sample_period_s) const {
    return std::visit([&](const auto& d) { return d.input(signal, sample_period_s); }, drive_);
  }
  [[nodiscard]] DisturbanceObserverConfig disturbance_observer(
      double sample_period_s, const ObserverCutoffs& cutoffs) const {
    return std::visit(
        [&](const auto& d) { return d.disturbance_observer(sample_period_s, cutoffs); }, drive_);
  }
  [[nodiscard]] const ObserverCutoffs& observer() const {
    return std::visit([](const auto& d) -> const ObserverCutoffs& { return d.observer; }, drive_);
  }
  [[nodiscard]] DriveEffectsConfig& effects() {
    return std::visit([](auto& d) -> DriveEffectsConfig& { return d.effects; }, drive_);
  }
  /// Nm/A or N/A.
  [[nodiscard]] double effort_per_ampere() const {
    const auto* axis = std::get_if<AxisConfig>(&drive_);
    return axis != nullptr ? axis->force_per_ampere()
                           : std::get<SpindleConfig>(drive_).torque_constant_Nm_per_A;
  }
  /// Of a turn of the drive's unit_per_turn.
  [[nodiscard]] double encoder_counts_per_rev() const {
    return std::visit([](const auto& d) { return d.encoder_counts_per_rev; }, drive_);
  }
  [[nodiscard]] unsigned counter_bits() const {
    return std::visit([](const auto& d) { return d.counter_bits; }, drive_);
  }

 private:
  std::variant<SpindleConfig, AxisConfig> drive_;
};

/// Takes out what only a current shows where the drive reports another `effort`; what is said of
/// that, empty where nothing was taken out.
[[nodiscard]] std::string leave_out_effects_of_current(Channel drive, EffortKind effort,
                                                       DriveEffectsConfig& effects);

/// spindle_config() or axis_config().
Expected<DriveConfig> drive_config(const MachineFile& machine, Channel channel);

/// Of a drive that two motors move, of which the trace has one: `effort_share` of its section.
struct EffortShare {
  double share = 1;           ///< of the whole effort, 0..1
  double relative_error = 0;  ///< standard error over the share
  std::string said;           ///< for a reader; empty where the motor is the only one
};
[[nodiscard]] EffortShare effort_share(const MachineFile& machine, Channel channel);

/// Noise of the estimate in the air that `identify idle` has found for an observer of this cutoff,
/// rms [N or Nm]; 0 where it has not.
[[nodiscard]] double estimate_noise(const MachineFile& machine, Channel channel,
                                    double cutoff_rad_s);

/// Effects of one channel that the real-time model can carry; others (of the tool, or reported
/// only) are passed over.
Expected<DriveEffectsConfig> drive_effects_config(const MachineFile& machine, Channel channel);

}  // namespace servosense
