// How far a further run may lie off runs that have been laid over each other.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "torque_band_alignment.hpp"

namespace servosense {

/// Variance of the torque from run to run, by what the motor gives: absolute + share size^2.
struct VarianceLaw {
  double absolute = 0, share = 0;
  [[nodiscard]] double at(double size_Nm) const { return absolute + share * size_Nm * size_Nm; }
};

/// Of one section.
struct SectionSpread {
  VarianceLaw law;   ///< of a run about the mean of all
  double width = 0;  ///< of the prediction interval of a further run, half of it, in deviations
  bool has_air = false;
  double air_Nm = 0;
  [[nodiscard]] double half_width_Nm(double size_Nm) const;
};
struct RunSpread {
  std::vector<SectionSpread> section;  ///< one each
  double level_deviation = 0;          ///< standard deviation of a cut's torque, part of it
  double air_limit_Nm = 0;
};

struct SpreadOptions {
  double false_alarms = 0.01;         ///< share of further runs that may lie farther off
  std::size_t behind = 0, ahead = 0;  ///< tolerance in time [points]
  std::size_t step = 1;               ///< that a torque is the mean of [points]
};

/// A run deviates by what the tolerance in time about the other runs' mean does not explain.
/// With one run the law is what is assumed, besides the run's own noise.
RunSpread spread_of(std::span<const AlignedSection> sections, const SpreadOptions& options);

}  // namespace servosense
