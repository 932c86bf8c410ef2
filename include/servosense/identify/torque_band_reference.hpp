// Reference of the torque band monitor, from a prediction or from taught runs.
//
// Magnitude first, then time (Bertok 1984, section 5.4.1):
//   upper0 = highest run + above,  lower0 = lowest run - below
//   upper(t) = greatest upper0, lower(t) = smallest lower0 within [t - lag, t + lead]
// Magnitude covers workpiece geometry, material and sharpness of the tool; time covers geometric
// inaccuracy over the feed. Several runs are aligned to the first by correlation; the expected
// torque is their mean.
#pragma once

#include <span>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/monitors/torque_band.hpp"

namespace servosense {

/// Torque at 0, spacing, 2 spacing, ... of the program, time [s] or path [m].
struct TorqueRun {
  double spacing = 0;
  std::vector<double> torque_Nm;
};

struct TorqueBandOptions {
  double above_Nm = 0;
  double above_share = 0;  ///< of the expected torque, besides above_Nm
  double below_Nm = 0;
  double below_share = 0;
  double lead = 0;       ///< that the measured torque may come early; as TorqueRun's spacing
  double lag = 0;        ///< that it may come late
  double max_shift = 0;  ///< of a run against the first
};

struct TorqueBand {
  double spacing = 0;
  std::vector<TorqueBandPoint<double>> points;
  std::vector<double> shift;  ///< of each run: it came so much later than the first

  /// The points as the monitor takes them.
  template <RealNumber Real>
  [[nodiscard]] std::vector<TorqueBandPoint<Real>> as() const {
    std::vector<TorqueBandPoint<Real>> out;
    out.reserve(points.size());
    for (const auto& p : points)
      out.push_back({static_cast<Real>(p.torque_Nm), static_cast<Real>(p.lower_Nm),
                     static_cast<Real>(p.upper_Nm)});
    return out;
  }
};

/// Usage error for negative tolerances and runs whose spacing differs; data error for runs that are
/// empty, too short, not finite, or unlike the first whatever the shift (correlation below 0.5).
Expected<TorqueBand> make_torque_band(std::span<const TorqueRun> runs,
                                      const TorqueBandOptions& options);

/// What above_Nm and below_Nm had to be, at least, for `measured` to stay within the band of
/// `expected`: the study chose its tolerances so.
struct MagnitudeTolerance {
  double above_Nm = 0;
  double below_Nm = 0;
};
Expected<MagnitudeTolerance> smallest_tolerance(const TorqueRun& expected,
                                                const TorqueRun& measured, double lead, double lag);

/// A run from samples of the servo rate: means over whole revolutions, as the monitor forms them,
/// interpolated at equal distances of the program. `advance`: progress of each sample.
Expected<TorqueRun> average_revolutions(std::span<const double> torque_Nm,
                                        std::span<const double> increment_rad,
                                        std::span<const double> advance, double spacing);

}  // namespace servosense
