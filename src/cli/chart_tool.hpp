// What of a tool a stability chart does not need, and what it would need and cannot know.
#pragma once

#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/model/milling.hpp"

namespace servosense::cli {

/// Adds a remark for each thing that is not used. Data error for broken teeth, and for run-out by
/// which teeth miss the cut.
Expected<Done> chart_knows(const MillingTool& tool, const MillingCut& cut,
                           std::vector<std::string>& remarks);

}  // namespace servosense::cli
