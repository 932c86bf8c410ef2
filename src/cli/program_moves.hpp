// A first look through an NC program: when its moves are made, and with what.
#pragma once

#include <vector>

#include "servosense/io/machine_file.hpp"
#include "servosense/process/program/program_reader.hpp"
#include "servosense/process/tool/machine_tools.hpp"

namespace servosense::cli {

/// All that a changed feed or speed changes.
struct MoveTechnology {
  double begin_s = 0, end_s = 0;
  double feed_per_tooth_m = 0;  ///< NaN where it is not known
  bool clockwise = true;
};

struct ProgramMoves {
  std::vector<MoveTechnology> moves;
  double duration_s = 0;
  double smallest_radius_m = 0;  ///< of the tools that move; infinite without one
  std::vector<int> tools;        ///< that move, each once
};

/// Errors of the program, and of a tool that the machine file has not.
Expected<ProgramMoves> moves_of(const process::ProgramText& program,
                                const process::ProgramOptions& options, const MachineFile& machine,
                                process::MachineTools& tools);

}  // namespace servosense::cli
