// The most productive cut that is stable with a stated probability, under limits of the machine.
//
// Every sample of the belief has a limit depth at every speed, by semi-discretisation. The share of
// samples whose limit lies deeper is the probability that a cut is stable. At each speed the
// deepest cut at that probability is given the largest feed that the limits leave; the cut that
// removes most is advised, after a search with more samples around the best speeds.
//
// Torque is the mean of a revolution, with the tangential coefficient that it exceeds with no more
// than 1 - probability; deflection the farthest of the periodic vibration
// (model/forced_deflection.hpp), likewise. Run-out does not move the limit while every tooth cuts
// (identify/semi_discretization.hpp); it takes its spread from the feed limit, and the feed must
// exceed it.
#pragma once

#include <Eigen/Dense>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/uncertain_cut.hpp"

namespace servosense {

struct CutLimits {
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  double least_rpm = 0, greatest_rpm = 0;
  double feed_per_tooth_m = 0;
  double axial_depth_m = 0;
  double torque_Nm = kNone;
  double power_W = kNone;
  double deflection_m = kNone;
};

struct RecommendConfig {
  double probability = 0.95;  ///< 0.5..0.999
  int speeds = 80;            ///< of the map, evenly spaced in their logarithm
  Eigen::Index map_samples = 120;
  bool gains = true;  ///< what further measurements would gain
  unsigned threads = 0;
  std::function<void(double)> progress;  ///< share done
};

/// A limit beside what the advised cut reaches of it.
struct LimitAtCut {
  std::string name;  ///< as in [limits]
  double limit = 0, value = 0;
  bool binds = false;  ///< it holds the cut back
};

struct AdvisedCut {
  double spindle_speed_rpm = 0;
  double axial_depth_m = 0;
  double feed_per_tooth_m = 0;
  double removal_m3_s = 0;
  double probability_stable = 0;
  std::vector<LimitAtCut> limits;
};

/// What the removal rate would gain at the same probability, were these parameters known.
struct MeasurementGain {
  std::string what;  ///< what to measure
  double gain = 0;   ///< of the removal rate, a share of it
};

struct TestCut {
  double spindle_speed_rpm = 0;
  double axial_depth_m = 0;
  double probability_stable = 0;
  double gain = 0;  ///< expected, as above
};

struct Recommendation {
  std::vector<double> spindle_speed_rpm;
  /// Limit depth: a row a speed, rising; infinite beyond the deepest cut allowed.
  Eigen::MatrixXd limit_depth_m;
  std::vector<double> depth_m;         ///< at the probability, of each speed
  std::optional<AdvisedCut> cut;       ///< nothing when no cut is allowed
  std::string why_not;                 ///< then
  double removal_if_known_m3_s = 0;    ///< expected, were everything known
  std::vector<MeasurementGain> gains;  ///< the largest first
  std::optional<TestCut> next_cut;     ///< of all test cuts the one that gains most

  /// Share of the samples that are stable.
  [[nodiscard]] double probability(std::size_t speed, double axial_depth_m) const;
};

/// `belief` at least 20 columns; the more, the finer the probability (some 1000). Errors: limits
/// that leave no speed, feed or depth; a probability out of range.
Expected<Recommendation> recommend_cut(const UncertainCut& cut, const CutBelief& belief,
                                       const CutLimits& limits, const RecommendConfig& config = {});

}  // namespace servosense
