// The greatest feed that a step of a cut stands, and what bounds it.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string_view>
#include <vector>

#include "servosense/io/machine_file.hpp"
#include "servosense/process/engagement/engagement.hpp"
#include "servosense/process/motion/motion_limits.hpp"
#include "servosense/process/program/canonical_move.hpp"
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

/// What a motor with less torque per current above its base speed keeps of its torque
/// ([effect.spindle.field-weakening]).
struct TorqueOverSpeed {
  double base_rad_s = std::numeric_limits<double>::infinity();
  double exponent = 1;
  std::vector<std::array<double, 2>> current_per_torque;  ///< speed [rad/s], ratio; else the law

  static TorqueOverSpeed from(const MachineFile& machine);
  /// 0..1, at a speed of 0 or more.
  [[nodiscard]] double share(double speed_rad_s) const;
};

/// [limits] of a machine file; infinite: not given.
struct CutLimits {
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  double torque_Nm = kNone, power_W = kNone, feed_per_tooth_m = kNone, deflection_m = kNone;
  double feed_m_s = kNone;
  TorqueOverSpeed over_speed;

  static CutLimits from(const MachineFile& machine);
  /// What the motor keeps of `torque_Nm` at a speed.
  [[nodiscard]] double torque_at(double spindle_rpm) const;
  /// Torque at which `power_W` is reached.
  [[nodiscard]] double torque_of_power(double spindle_rpm) const;
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

/// Whether F sets its speed.
[[nodiscard]] constexpr bool at_a_feed(const CanonicalMove& move) {
  return move.kind == CanonicalMove::Kind::feed || move.kind == CanonicalMove::Kind::arc;
}
/// Greatest speed along a move from `from` that no axis exceeds.
[[nodiscard]] double axis_speed(const CanonicalMove& move, const AxisPoint& from,
                                const MotionLimits& motion);

}  // namespace servosense::process
