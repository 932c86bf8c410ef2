// Torque or force per ampere over the motor's temperature (io/motor_temperature.hpp) in a record of
// a drive: as the machine file has it, what a record shows of it, and as it goes into the file.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servosense/io/drive_columns.hpp"
#include "servosense/io/trace.hpp"
#include "servosense/reconcile/drive.hpp"

namespace servosense::reconcile {

/// The effect. Its parameters are keys of the drive itself, and act where samples are made.
inline constexpr const char* kMotorTemperature = "torque-constant-temperature";
inline constexpr const char* kPerKelvinKey = "torque_constant_per_K";
/// How a change that the file has is called where it is refitted.
inline constexpr const char* kPerKelvin = "torque-constant-temperature torque_constant_per_K";

/// Temperatures of the samples, and efforts as `stated` of the machine file has them. Samples
/// before the first temperature do not count.
void read_temperature(const Trace& trace, const DriveColumns& columns,
                      const ConstantOverTemperature& stated, const std::vector<std::size_t>& row_of,
                      DriveData& data);

/// `constant` over that which the efforts have, a sample each; empty without temperatures.
[[nodiscard]] Column constant_ratio(const DriveData& data, const ConstantOverTemperature& constant);
/// Efforts as `constant` has them; as they are without one.
void set_constant(DriveData& data, const std::optional<ConstantOverTemperature>& constant);

/// What was found, into the section of the drive.
void write_constant(MachineFile& machine, const std::string& section, const FoundEffect& effect,
                    const std::string& provenance);

}  // namespace servosense::reconcile
