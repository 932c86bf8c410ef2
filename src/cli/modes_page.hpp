// The page of servosense identify modes: receptances with their fit, stabilisation diagram, tables.
#pragma once

#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/modes.hpp"

namespace servosense::cli {

/// What was found in one direction.
struct ModesOfAxis {
  std::string axis;  ///< "x", "y"
  ModesIdentification found;
};

Expected<Done> write_modes_page(const std::string& path, const std::vector<ModesOfAxis>& all);

}  // namespace servosense::cli
