// What an idling run told of one drive: in the machine file, on the screen, as JSON.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servosense/identify/idle.hpp"
#include "servosense/identify/idle_temperature.hpp"
#include "servosense/identify/learn_pairs.hpp"
#include "servosense/identify/learn_thresholds.hpp"
#include "servosense/identify/power_losses.hpp"
#include "servosense/identify/slow_vibration.hpp"
#include "servosense/identify/torque_path.hpp"
#include "servosense/io/machine_file.hpp"

namespace servosense::cli {

inline constexpr const char* kIdleProvenance = "servosense identify idle";

/// What was learned of one drive, as printed.
struct IdleFound {
  Channel channel = Channel::spindle;
  std::string unit;                              // of its effort
  std::optional<RunningEffort> running;          // where speeds do not tell friction apart
  std::optional<IdleIdentification> parameters;  // nothing: the motion shows thresholds alone
  std::optional<TorquePath> path;                // with the parameters
  LearnedCollision collision;
  LearnedChatter chatter;
  std::optional<LearnedVibration> lines;  // of a slow record
  std::optional<ToothNoise> tooth;
  std::optional<SeenConstantOverTemperature> over_temperature;  // where one is recorded
  ConstantOverTemperature constant;                             // as stated, or as found
  std::optional<FoundLosses> power;                             // where the effort is one
  double cutting_torque_Nm = 0;
  bool torque_constant_sought = false;
  bool saturation_sought = false;
  double ampere = 0;       // torque of one, where that is sought
  bool load_helps = true;  // the monitors read less with the constant load
  std::optional<LearnedPairs> pairs;
  bool backlash_helps = false;  // likewise with the backlash that motor and load show
};

/// Names of what is found, in the file and in JSON.
struct IdleKeys {
  const char *inertia, *viscous, *coulomb, *knee, *noise_floor, *smallest_step, *constant_load,
      *effort, *speed, *load_effect;
};
[[nodiscard]] constexpr IdleKeys idle_keys(Channel channel) {
  return is_turning(channel) ? IdleKeys{"inertia_kg_m2",       "viscous_friction_Nm_s_per_rad",
                                        "coulomb_friction_Nm", "friction_knee_rad",
                                        "noise_floor_Nm",      "smallest_step_Nm",
                                        "constant_load_Nm",    "effort_Nm",
                                        "speed_rad_s",         "torque_Nm"}
                             : IdleKeys{"equivalent_mass_kg", "viscous_friction_N_s_per_m",
                                        "coulomb_friction_N", "friction_knee_m",
                                        "noise_floor_N",      "smallest_step_N",
                                        "constant_load_N",    "effort_N",
                                        "speed_m_s",          "force_N"};
}

/// A load that its error cannot tell from nothing is none.
[[nodiscard]] bool is_load(const IdleIdentification& idle);
inline constexpr const char* kWeakening = "field-weakening";
inline constexpr const char* kSaturation = "torque-saturation";
[[nodiscard]] std::string effect_section(Channel channel, const std::string& effect);
[[nodiscard]] Estimate in_ampere(const Estimate& effort, const IdleFound& found);
/// What the run lacks to show whether torque per ampere falls with current; empty where it shows.
[[nodiscard]] std::string saturation_remark(const IdleFound& found);
/// "one false alarm in 130 hours"
[[nodiscard]] std::string false_alarm_text(double per_hour);
template <typename Learned>
[[nodiscard]] std::string rate_of(const Learned& learned) {
  return false_alarm_text(learned.alarms_per_hour());
}

/// What is lost of a power; `slower`: why it tells nothing of the torque below its speed.
void write_losses(MachineFile& machine, const std::string& section, const FoundLosses& power,
                  const char* slower);
/// `cutoff`: of the drive's own observer [rad/s], for which the floor is stated.
void write_found(MachineFile& machine, const IdleFound& found, double cutoff);
void print_found(const IdleFound& found);
/// What comes next: what the idling run cannot teach, or the watch itself.
[[nodiscard]] std::string next_step(const std::vector<IdleFound>& all, const std::string& out);
struct SensorFound;  // sensor_watches.hpp
void print_idle_json(const std::vector<IdleFound>& all, const std::vector<SensorFound>& sensors,
                     const std::vector<std::string>& remarks, const std::string& out);

}  // namespace servosense::cli
