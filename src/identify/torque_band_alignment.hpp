// Runs of a program laid over the first one, section by section.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/torque_run.hpp"

namespace servosense {

/// A section of the first run, points [from, to), with the other runs laid over it.
struct AlignedSection {
  std::size_t from = 0, to = 0;
  double speed_rad_s = 0;
  double friction_Nm = 0;
  bool joined = false;                         ///< to the one before: only a block has begun
  bool matched = true;                         ///< in all runs
  std::vector<std::vector<double>> torque_Nm;  ///< of each run, at the section's points
  std::vector<std::vector<double>> feed;       ///< likewise; empty where a run has none
  std::vector<double> shift;                   ///< of each run [points]
};

/// Largest shift [points] of the first section and of the others, and by how much it may drift,
/// part of the way.
struct AlignmentLimits {
  int most = 0;
  int sync = 0;
  double drift = 0.02;
};

/// Data error when a run is unlike the first.
Expected<std::vector<AlignedSection>> align_runs(std::span<const TorqueRun> runs,
                                                 const AlignmentLimits& limits);

}  // namespace servosense
