// Ramps in the cut: where in a record the tool cuts while the spindle changes its speed.
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include "servosense/identify/stable_speeds.hpp"

namespace servosense {

/// Fewest teeth in which a ramp shows its lobes.
inline constexpr std::size_t kFewestTeeth = 64;

/// Samples `first` to `last`, which is not one of them.
struct RampSpan {
  std::size_t first = 0, last = 0;
};

struct RampsOfRecord {
  std::vector<RampSpan> ramps;  ///< the speed rises or falls by a tenth or more in each
  /// The torque tells the cut from the air. Otherwise everything counts as cut.
  bool cut_stands_out = false;
  double cutting_torque_Nm = std::numeric_limits<double>::quiet_NaN();  ///< mean, less that of air
  std::vector<RampSpan> air;  ///< revolutions in which nothing cuts, where the cut stands out
};

/// Requires torque and speed of one length, finite.
[[nodiscard]] RampsOfRecord ramps_in_cut(const CuttingTorqueTrace& record, int teeth);

/// Mean square of what differs from one revolution in the air to the next, of each; 0 when no two
/// follow each other.
[[nodiscard]] double noise_in_air(const std::vector<double>& torque,
                                  const std::vector<RampSpan>& air);

/// Gaussian low-pass, symmetric in time, half the power at the cutoff.
[[nodiscard]] std::vector<double> low_passed(const std::vector<double>& x, double sample_rate_hz,
                                             double cutoff_hz);

/// The value that this share of all lies below; 0 when there is none.
[[nodiscard]] double percentile(std::vector<double> values, double share);

}  // namespace servosense
