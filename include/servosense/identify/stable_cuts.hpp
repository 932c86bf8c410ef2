// How probable it is that all cuts that a tool makes at one speed are stable, its parameters being
// known with errors (identify/uncertain_cut.hpp).
//
// A sample of the belief counts where the largest multiplier of every cut, by semi-discretisation
// (identify/semi_discretization.hpp), lies in the unit circle. The cuts nearest to instability with
// the middle values stand for the others: kNearest of them are looked at in every sample.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/identify/uncertain_cut.hpp"
#include "servosense/model/milling.hpp"

namespace servosense {

class StableCuts {
 public:
  /// Chosen: what lies behind the twelfth is hardly ever the first to chatter.
  static constexpr std::size_t kNearest = 12;

  struct Cut {
    /// About the axes of the structure (SemiDiscretization::create).
    Engagement engagement;
    double axial_depth_m = 0;
  };

  /// Structure and tool of `tool`; its own cut is not used. A column of `belief` is a sample.
  StableCuts(UncertainCut tool, CutBelief belief, std::vector<Cut> cuts)
      : tool_(std::move(tool)), belief_(std::move(belief)), cuts_(std::move(cuts)) {}

  /// Share of the samples in which every cut is stable at a speed above 0. 0 where it is less than
  /// `least`: counting ends as soon as that is known. A cut that is unstable with the middle values
  /// counts as unstable in all where `least` is above one half.
  [[nodiscard]] double probability(double spindle_speed_rpm, double least = 0) const;

 private:
  UncertainCut tool_;
  CutBelief belief_;
  std::vector<Cut> cuts_;
};

}  // namespace servosense
