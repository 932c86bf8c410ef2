// Feed that the limits leave at a speed and depth, and the depth at which most is removed.
#pragma once

#include <vector>

#include "servosense/identify/recommended_cut.hpp"
#include "servosense/model/forced_deflection.hpp"

namespace servosense {

struct FeedAndDepth {
  double axial_depth_m = 0;
  double feed_per_tooth_m = 0;
  double removal_m3_s = 0;
};

class FeedUnderLimits {
 public:
  /// `belief`: some samples, over which torque and deflection are the worst at `probability`.
  FeedUnderLimits(const UncertainCut& cut, const CutBelief& belief, const CutLimits& limits,
                  double probability);

  /// Largest feed per tooth; 0 when none is allowed.
  [[nodiscard]] double feed(double spindle_speed_rpm, double axial_depth_m) const;
  /// The best cut no deeper than `deepest_m`.
  [[nodiscard]] FeedAndDepth best(double spindle_speed_rpm, double deepest_m) const;
  [[nodiscard]] std::vector<LimitAtCut> at(double spindle_speed_rpm, const FeedAndDepth& best,
                                           bool stability_binds) const;
  /// What run-out takes from the feed limit, and what the feed must exceed.
  [[nodiscard]] double throw_spread_m() const { return spread_m_; }

 private:
  [[nodiscard]] double removal(double spindle_speed_rpm, double axial_depth_m, double feed_m) const;
  /// Mean of a revolution.
  [[nodiscard]] double torque(double axial_depth_m, double feed_m) const;
  [[nodiscard]] std::vector<ForcedDeflection> deflections(double spindle_speed_rpm,
                                                          double axial_depth_m) const;
  /// That no more than 1 - probability exceed.
  [[nodiscard]] double farthest(const std::vector<ForcedDeflection>& deflections,
                                double feed_m) const;

  const UncertainCut& cut_;
  CutLimits limits_;
  double probability_;
  std::vector<UncertainCut::Possible> possible_;
  double tangential_factor_ = 1;
  double spread_m_ = 0;
};

}  // namespace servosense
