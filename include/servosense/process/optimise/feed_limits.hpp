// The greatest feed that a step of a cut stands, and what bounds it.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string_view>

#include "servosense/io/machine_file.hpp"
#include "servosense/process/engagement/engagement.hpp"
#include "servosense/process/torque/tool_law.hpp"

namespace servosense::process {

enum class FeedBound : std::uint8_t {
  none,
  torque,
  power,
  feed_per_tooth,
  deflection,
  feed,          ///< [limits] feed_m_s
  axis_speed,    ///< what the axes can do along the move
  acceleration,  ///< more would not be reached
  fixed,         ///< the block keeps its feed: why, FeedPlan tells
};
/// As in JSON: the words of the enumerator, with hyphens.
[[nodiscard]] std::string_view bound_name(FeedBound bound);

/// [limits] of a machine file; infinite: not given.
struct CutLimits {
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  double torque_Nm = kNone, power_W = kNone, feed_per_tooth_m = kNone, deflection_m = kNone;
  double feed_m_s = kNone;

  static CutLimits from(const MachineFile& machine);
  /// Whether any of them bounds the feed in a cut by what the cut does.
  [[nodiscard]] bool bound_a_cut() const;
};

struct BoundFeed {
  double feed_m_s = CutLimits::kNone;
  FeedBound bound = FeedBound::none;
  void add(double candidate_m_s, FeedBound by) {
    if (candidate_m_s < feed_m_s) feed_m_s = candidate_m_s, bound = by;
  }
};

/// Of a step that cuts, by the mean torque of a revolution; 0 or less: no feed is low enough.
/// The law knows its torque where torque or power is limited, its forces where deflection is.
[[nodiscard]] BoundFeed bound_feed(const Engagement& engagement, const ToolLaw& law,
                                   double spindle_rpm,
                                   const std::array<double, 2>& compliance_m_per_N,
                                   const CutLimits& limits);

}  // namespace servosense::process
