// What `servosense recommend` reads from a machine file: tool, cut, modes, how well each is known,
// and the limits.
#pragma once

#include <string>
#include <vector>

#include "servosense/identify/recommended_cut.hpp"
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

struct RecommendInputs {
  UncertainCut cut;
  CutLimits limits;
  std::vector<ErrorStated> errors;
  std::vector<std::string> remarks;
};

Expected<RecommendInputs> recommend_inputs(const MachineFile& machine);

}  // namespace servosense::cli
