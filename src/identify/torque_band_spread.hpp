// How far a further run may lie off runs that have been laid over each other.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "torque_band_alignment.hpp"

namespace servosense {

/// Of one section.
struct SectionSpread {
  double half_width_Nm = 0;  ///< of the prediction interval of a further run
  bool has_air = false;
  double air_Nm = 0;
};
struct RunSpread {
  std::vector<SectionSpread> section;  ///< one each
  double level_deviation = 0;          ///< standard deviation of a section's level, part of it
  double air_limit_Nm = 0;
};

struct SpreadOptions {
  double false_alarms = 0.01;         ///< share of further runs that may lie farther off
  std::size_t behind = 0, ahead = 0;  ///< tolerance in time [points]
};

/// A run deviates by what the tolerance in time about the other runs' mean does not explain.
/// With one run only the air is found.
RunSpread spread_of(std::span<const AlignedSection> sections, const SpreadOptions& options);

}  // namespace servosense
