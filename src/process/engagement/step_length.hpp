// How long a step is.
#pragma once

#include <cmath>

#include "servosense/process/tool/sweep.hpp"

namespace servosense::process {

[[nodiscard]] inline double length_of(const Point& from, const Point& to) {
  return std::hypot(to[0] - from[0], to[1] - from[1], to[2] - from[2]);
}

}  // namespace servosense::process
