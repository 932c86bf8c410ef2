// What turns of the tools of a machine file.
#pragma once

#include "servosense/process/engagement/program_engagement.hpp"
#include "servosense/process/tool/machine_tools.hpp"

namespace servosense::process {

/// `tools` outlives what is returned.
[[nodiscard]] inline ProgramEngagement::Cutters cutters_of(MachineTools& tools) {
  return [&tools](int number) -> Expected<ProgramEngagement::Turning> {
    const auto tool = tools.of(number);
    if (!tool) return tool.error();
    const auto pointer = [](const std::optional<Cutter>& c) { return c ? &*c : nullptr; };
    return ProgramEngagement::Turning{&(*tool)->cutter, pointer((*tool)->holder),
                                      pointer((*tool)->shank)};
  };
}

}  // namespace servosense::process
