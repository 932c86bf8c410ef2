// A machine file as configuration of the C interface: the one way, whether it is then handed to
// servosense_init (machine_file.h, the LinuxCNC component) or written out for flash (servosense
// export).
#pragma once

#include <array>
#include <string>
#include <vector>

#include "servosense/capi/servosense.h"
#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"

namespace servosense {

/// `config` with what it points to: move it, do not copy it.
struct MachineConfig {
  servosense_config config{};
  /// Of the spindle and each axis.
  std::array<std::vector<servosense_effect>, 1 + SERVOSENSE_AXES> effects;
  std::vector<servosense_band_point> reference;
  std::vector<servosense_band_section> sections;
  std::vector<MonitorAvailability> monitors;
  std::vector<std::string> remarks;

  MachineConfig() = default;
  MachineConfig(const MachineConfig&) = delete;
  MachineConfig& operator=(const MachineConfig&) = delete;
  MachineConfig(MachineConfig&&) = default;
  MachineConfig& operator=(MachineConfig&&) = default;
};

/// Everything that the machine file has for monitors on these signals, as plan_stack() reads it.
/// Data error where the C interface has no room for it (revolutions, harmonics, teeth).
Expected<MachineConfig> machine_config(const MachineFile& machine, const StackSignals& signals);

/// What the drives report where no record tells: counts where the file has encoder_counts_per_rev,
/// else position; a current where it has a torque or force constant, else torque or force; every
/// drive that has a section. Data error without sample_rate_hz.
Expected<StackSignals> signals_of_file(const MachineFile& machine);

/// C99: constants named `name` and name_..., for a header.
std::string c_header(const MachineConfig& machine, const std::string& name,
                     const std::string& title);

}  // namespace servosense
