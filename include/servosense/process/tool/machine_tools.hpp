// The tools of a machine file: [tool.N] of tool number N, or [tool] for all that have none.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>

#include "servosense/core/expected.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/process/tool/cutter.hpp"

namespace servosense::process {

struct MillingTool {
  Cutter cutter;
  std::optional<Cutter> holder, shank;
  std::optional<int> teeth;
  /// From the spindle's gauge line to the tip, as measured [m].
  std::optional<double> length_m;
  /// Steepest way down into material [deg]; 90: straight down.
  double ramp_angle_deg = 90;
};

/// Section of tool number `number`: its own, or that of all tools.
[[nodiscard]] std::string tool_section(const MachineFile& file, int number);

/// Reads each tool once, when it is asked for.
class MachineTools {
 public:
  /// `file` outlives the tools.
  explicit MachineTools(const MachineFile& file) : file_(&file) {}
  /// It stays where it is. Data error for a tool that the file has not, or whose shape is none.
  Expected<const MillingTool*> of(int number);

 private:
  const MachineFile* file_;
  std::map<int, std::unique_ptr<MillingTool>> known_;
};

}  // namespace servosense::process
