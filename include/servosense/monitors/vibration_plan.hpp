// The sensors that hear chatter beside the drives, from the machine file.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servosense/core/channel.hpp"
#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/sensor_chatter.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

using HostSensorChatter = SensorChatter<double, kHostRevolutions, kHostHarmonics>;

/// "accelerometer.acceleration_m_s2", "microphone.sound_Pa": where the machine file names no other.
[[nodiscard]] Signal usual_column(Channel sensor) noexcept;
/// "m/s2" or "Pa".
[[nodiscard]] const char* unit_of_sensor(Channel sensor) noexcept;

/// Keys of [monitor.chatter.accelerometer] whose names have the unit.
struct SensorKeys {
  const char *per_unit, *noise, *threshold;
};
[[nodiscard]] SensorKeys sensor_keys(Channel sensor) noexcept;

/// Of the tool's spindle: teeth, window, speeds; the rest as sensor_chatter_defaults() has it.
[[nodiscard]] SensorChatterConfig sensor_config(const StackPlan& plan, Channel sensor,
                                                double sample_period_s);

/// A sensor of which the machine file or the source knows.
struct PlannedSensor {
  SensorChatterConfig config;
  std::size_t column = 0;
  double per_unit = 1;  ///< m/s2 or Pa a unit of the column
};
/// The columns of the sensors: that of the machine file's `column`, else the usual one. Nothing for
/// a sensor that is not there.
[[nodiscard]] std::optional<std::size_t> sensor_column(const MachineFile& machine, Channel sensor,
                                                       const std::vector<Signal>& signals);
/// Whether it runs goes to `plan`, with the reason; nothing where it does not, or where neither
/// file nor source know of it. Data error for keys that no monitor accepts.
Expected<std::optional<PlannedSensor>> plan_sensor(const MachineFile& machine, Channel sensor,
                                                   const std::vector<Signal>& signals,
                                                   double sample_period_s, StackPlan& plan);

}  // namespace servosense
