// Which monitors can run on what a machine reports, and the stack that runs them.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/cutting_coefficients_config.hpp"
#include "servosense/monitors/friction_follower.hpp"
#include "servosense/monitors/monitor_stack.hpp"
#include "servosense/monitors/sees_from.hpp"
#include "servosense/monitors/torque_band_file.hpp"

namespace servosense {

/// The stack of the program: room for long windows of many harmonics.
inline constexpr std::size_t kHostRevolutions = 32;
inline constexpr std::size_t kHostHarmonics = 40;
inline constexpr std::size_t kHostTeeth = 16;
using HostStack =
    MonitorStack<double, kHostRevolutions, kHostHarmonics, 16384, kHostTeeth, kAllAxes>;

/// What a source delivers.
struct StackSignals {
  double sample_period_s = 125e-6;
  std::optional<DriveSignal> spindle;
  std::array<std::optional<DriveSignal>, kAllAxes> axis;
  bool nc_block = false;  ///< the controller reports the block that it works on
  std::optional<DriveSignal> spindle2 = {};

  [[nodiscard]] std::optional<DriveSignal>& drive(Channel channel) {
    return channel == Channel::spindle    ? spindle
           : channel == Channel::spindle2 ? spindle2
                                          : axis[axis_index(channel)];
  }
  [[nodiscard]] const std::optional<DriveSignal>& drive(Channel channel) const {
    return const_cast<StackSignals*>(this)->drive(channel);
  }
};

/// Whether a monitor runs on a channel, and why not.
struct MonitorAvailability {
  MonitorId monitor = MonitorId::signal;
  Channel channel = Channel::machine;
  bool runs = false;
  std::string reason;    ///< a sentence: what it watches, or what is missing and what to do
  std::string obstacle;  ///< why it does not run, in a word or two; empty when it runs
  std::optional<SeesFrom> sees_from = {};  ///< after a run: the smallest thing it would have found
};

struct StackPlan {
  HostStackConfig config;  ///< at the rate of the signals, as thresholds are learned
  /// The spindle of `config`: that of the tool ([tool] spindle).
  Channel tool_spindle = Channel::spindle;
  /// The other has a stack of its own, of which only the slot of the spindle is present.
  std::optional<HostStackConfig> second;
  bool grouped = false;  ///< prepare() runs it in_groups()
  std::vector<MonitorAvailability> monitors;
  /// Reference of the torque band; empty when that does not run. Must outlive the stack's use.
  std::vector<TorqueBandPoint<double>> torque_band;
  std::vector<TorqueBandSection<double>> torque_band_sections;
  /// What else its program asks for, beside the points, and the engagements that these name.
  std::vector<ExpectedCut<double>> expected_cuts;
  std::vector<PredictedEngagement> engagements;
  std::vector<TorqueBandChange<double>> torque_band_changes;
  std::vector<ToothLines<double>> tooth_lines;  ///< of those engagements; empty: not counted
  std::string teeth_not_counted;                ///< why
  /// Of those, where the coefficients are of the program's tool; else empty.
  std::vector<CuttingShares> engagement_shares;
  /// Of spindle and spindle2, whose effort is a current; 0: at all speeds, or not stated.
  std::array<double, 2> torque_constant_known_to_rad_s{};
  std::optional<std::array<double, 2>> taught_thrust_N;   ///< of wear: mean and scatter
  std::optional<std::array<double, 2>> taught_torque_Nm;  ///< likewise
  std::optional<FrictionFollowerConfig> follow;  ///< of the spindle, where the file asks for it
  /// Where the file asks for them and says the cut.
  std::optional<CuttingCoefficientsConfig> coefficients;
  std::vector<std::string> remarks;  ///< for example a cutoff lowered to suit the sample rate

  /// The stack that hears a drive.
  [[nodiscard]] const HostStackConfig& stack_of(Channel drive) const {
    return second && drive == other_spindle(tool_spindle) ? *second : config;
  }
  /// Up to which its torque constant is known; 0: at all speeds, or not stated.
  [[nodiscard]] double known_to_rad_s(Channel spindle) const {
    return torque_constant_known_to_rad_s[spindle == Channel::spindle2 ? 1 : 0];
  }
  /// The slot of a drive that is present; nullptr where it is not.
  [[nodiscard]] const HostDriveSlotConfig* slot_of(Channel drive) const;
};

/// The observer that the chatter monitor of a spindle or the collision monitor of an axis listens
/// to. Effects that the machine file keeps from the monitors (used_by_monitors = no) are left out,
/// and so are those of a current where the drive reports another `effort`.
Expected<DisturbanceObserverConfig> monitor_observer(const MachineFile& machine, Channel channel,
                                                     EffortKind effort, double sample_period_s);

/// Configures the stack from the machine file for these signals. A monitor that lacks a threshold
/// is planned and idles. Data error when the machine file cannot serve a drive that reports (counts
/// without encoder_counts_per_rev, current without a torque constant...).
Expected<StackPlan> plan_stack(const MachineFile& machine, const StackSignals& signals);

/// Configures `stack`, hands it the references of the plan and starts the program of the torque
/// band. The spindle without the tool is not of it (MachineStack, machine_stack.hpp).
void prepare(HostStack& stack, const StackPlan& plan);

/// What [monitor.torque-band] need not say.
TorqueBandConfig torque_band_defaults(bool over_path);
/// The plan with this reference in place of its own. The monitor is not switched on by it.
void use_torque_band(StackPlan& plan, TorqueBandReference reference);

/// Highest observer cutoff that is used at a sample period: beyond it the Tustin form rings.
[[nodiscard]] constexpr double highest_cutoff_rad_s(double sample_period_s) {
  return 1 / sample_period_s;
}

}  // namespace servosense
