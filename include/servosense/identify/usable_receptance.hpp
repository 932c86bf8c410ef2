// Which lines of a measured receptance can be used?
//
// Left out, aloud:
//   low coherence   below 0.8 a line is more noise than response (its error is
//                   (1 - coherence) / (2 averages coherence); Dunwoody 2010, ch. 4)
//   bottom          a tool that is held gives way along a force that changes slowly: below its
//   first
//                   resonance the real part is positive, and at the point of the force the
//                   imaginary part is never above zero, as it dissipates. An acceleration that was
//                   integrated twice breaks both there: its noise grows as 1 / f^2. So the lines
//                   below the first run that keeps both are left out, if some of them break the
//                   second.
// A receptance between two points may have any phase: only coherence is asked of it.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "servosense/identify/stability_lobes.hpp"
#include "servosense/io/frf_file.hpp"

namespace servosense {

struct UsableReceptance {
  ReceptanceTable table;
  std::vector<std::size_t> lines;  ///< of what was measured: those in the table
  std::string remark;              ///< what was left out and why; empty when nothing was
};

/// Of a response at the point of the force, if `direct`, or at another. Data error when fewer than
/// 8 lines are left.
[[nodiscard]] Expected<UsableReceptance> usable_receptance(const FrequencyResponse& measured,
                                                           const std::string& name,
                                                           bool direct = true);

}  // namespace servosense
