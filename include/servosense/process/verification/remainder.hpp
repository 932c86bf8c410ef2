// What a program leaves on the target.
#pragma once

#include <optional>

#include "servosense/process/verification/finding.hpp"
#include "servosense/process/workpiece/workpiece.hpp"

namespace servosense::process {

struct Remainder {
  double volume_m3 = 0;
  double greatest_height_m = 0;  ///< of one stretch, along z
  Point at{};                    ///< middle of that
};

/// Material of `workpiece` that lies farther than `tolerance_m` above or below `target`, and
/// farther aside than to the target's next lines: by the lines along z of both.
[[nodiscard]] Remainder remainder_of(const Workpiece& workpiece, const Workpiece& target,
                                     double tolerance_m);
/// As a finding without a line; nothing if there is none.
[[nodiscard]] std::optional<Finding> finding_of(const Remainder& remainder, double tolerance_m);

}  // namespace servosense::process
