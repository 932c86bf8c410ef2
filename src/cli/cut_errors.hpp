// How well a machine file says that tool and structure are known, and what is taken where it does
// not.
#pragma once

#include <string>
#include <vector>

#include "servosense/identify/uncertain_cut.hpp"
#include "servosense/io/machine_file.hpp"

namespace servosense::cli {

/// A standard error and where it is from.
struct ErrorStated {
  std::string parameter;
  double standard_error = 0;
  bool stated = false;
  std::string source;
};

struct CutErrorsKnown {
  CutErrors errors;
  std::vector<ErrorStated> sources;
  std::vector<std::string> remarks;
};

/// Of the tool of a section, but for its run-out. A radial ratio of 0, which nobody has measured,
/// becomes the usual one.
CutErrorsKnown tool_errors(const MachineFile& machine, const std::string& section,
                           MillingTool& tool);
/// Adds those of the modes; a data error for a number of triples that is not that of the modes.
Expected<Done> add_mode_errors(const MachineFile& machine, const Structure& structure,
                               CutErrorsKnown& known);
/// [structure.x] and [structure.y], with modes alone; a data error for receptances, whose errors
/// are not known.
Expected<Structure> structure_with_errors(const MachineFile& machine);

}  // namespace servosense::cli
