// What `servosense recommend` reads from a machine file: tool, cut, modes, how well each is known,
// and the limits.
#pragma once

#include <string>
#include <vector>

#include "cut_errors.hpp"
#include "servosense/identify/recommended_cut.hpp"
#include "servosense/identify/uncertain_cut.hpp"
#include "servosense/io/machine_file.hpp"

namespace servosense::cli {

struct RecommendInputs {
  UncertainCut cut;
  CutLimits limits;
  std::vector<ErrorStated> errors;
  std::vector<std::string> remarks;
};

Expected<RecommendInputs> recommend_inputs(const MachineFile& machine);

}  // namespace servosense::cli
