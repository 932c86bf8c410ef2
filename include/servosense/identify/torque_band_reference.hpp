// Reference of the torque band monitor, from a prediction or from taught runs.
//
// Magnitude first, then time (Bertok 1984, section 5.4.1):
//   upper0 = highest run + above,  lower0 = lowest run - below
//   upper(t) = greatest upper0, lower(t) = smallest lower0 within [t - lag, t + lead]
// Magnitude covers workpiece geometry, material and sharpness of the tool; time covers geometric
// inaccuracy over the feed. Several runs are aligned to the first, section by section (least
// squares, within max_shift, drifting by max_drift at most); the expected torque is their mean.
// With false_alarms the magnitude is also learned: it is at least
//   t(1 - false_alarms / 2 S) sqrt(1 + 1 / R) sqrt(s^2 + v^2)
// for R runs and S sections, t the quantile of Student's distribution, s the standard deviation of
// a section's level between runs and v of the torque within it, of what the tolerance in time does
// not explain: the prediction interval of a further run, so that all sections together leave it in
// a share of false_alarms of all sound runs at most (Bonferroni). s: of all sections' runs as a law
// s^2 = a + b level^2 with all their degrees of freedom; the root of b begins at 3 %, which counts
// for four of them. Where a section's own runs differ by more than that, they count too, by their
// degrees of freedom. Levels and shares are of the motor's torque: friction differs from run to run
// too.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/torque_run.hpp"
#include "servosense/monitors/torque_band_points.hpp"

namespace servosense {

struct TorqueBandOptions {
  double above_Nm = 0;
  double above_share = 0;  ///< of the motor's torque, friction included, besides above_Nm
  double below_Nm = 0;
  double below_share = 0;
  double lead = 0;          ///< that the measured torque may come early; as TorqueRun's spacing
  double lag = 0;           ///< that it may come late
  double max_shift = 0;     ///< of a run against the first, where its first section begins...
  double sync_shift = 0.2;  ///< ...and where the others do
  double max_drift = 0.02;
  double widening = 1;      ///< of what is learned
  double false_alarms = 0;  ///< sound runs that may leave the band, a share; 0 = not learned
};

struct TorqueBand {
  double spacing = 0;
  std::vector<TorqueBandPoint<double>> points;
  std::vector<TorqueBandSection<double>> sections;  ///< empty when the runs have none
  std::vector<double> shift;   ///< of each run: it came so much later than the first, on average
  double unmatched = 0;        ///< length of what not all runs have: nothing is expected there
  double level_deviation = 0;  ///< of a section between runs, standard, part of its level
  double air_limit_Nm = 0;     ///< by which the air level may differ from the taught one

  /// The points as the monitor takes them.
  template <RealNumber Real>
  [[nodiscard]] std::vector<TorqueBandPoint<Real>> as() const {
    std::vector<TorqueBandPoint<Real>> out;
    out.reserve(points.size());
    for (const auto& p : points)
      out.push_back({static_cast<Real>(p.torque_Nm), static_cast<Real>(p.lower_Nm),
                     static_cast<Real>(p.upper_Nm), static_cast<Real>(p.feed)});
    return out;
  }
};

/// Usage error for negative tolerances and runs whose spacing differs; data error for runs that are
/// empty, too short, not finite, or unlike the first whatever the shift: neither its course
/// (correlation below 0.5) nor its level (off by a quarter, rms), or more than half of it missing.
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

}  // namespace servosense
