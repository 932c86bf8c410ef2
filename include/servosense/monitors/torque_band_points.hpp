// The reference of the torque band monitor, as it lies in the caller's memory.
#pragma once

#include <cstdint>
#include <span>

#include "servosense/core/real_time.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/monitors/expected_cut.hpp"
#include "servosense/monitors/tooth_lines.hpp"

namespace servosense {

/// Nothing is expected where lower_Nm > upper_Nm.
template <RealNumber Real>
struct TorqueBandPoint {
  Real torque_Nm = 0;  ///< expected
  Real lower_Nm = 0;
  Real upper_Nm = 0;
  Real feed = 0;  ///< at which that is so: progress per second; 0 = unknown
  [[nodiscard]] bool expects() const noexcept { return lower_Nm <= upper_Nm; }
};

/// A stretch of the program that begins where the controller or the spindle tells.
template <RealNumber Real>
struct TorqueBandSection {
  std::uint32_t first = 0;  ///< point of the reference
  std::int32_t block = kNoBlock;
  Real speed_rad_s = 0;  ///< of the spindle, absolute; 0 = unknown
  bool has_air = false;
  bool behind_gap = false;  ///< nobody heard how the program came here
  Real air_Nm = 0;          ///< level of the torque while the tool cuts air
};

/// What the program would ask for there with another tool or stock, less what it does: how a cause
/// shows along the program. Of a change of any size; 0 where it is not known.
template <RealNumber Real>
struct TorqueBandChange {
  Real wider_Nm = 0;   ///< of a tool of a larger diameter
  Real higher_Nm = 0;  ///< of stock that stands higher
};

template <RealNumber Real>
struct TorqueBandView {
  std::span<const TorqueBandPoint<Real>> points;
  /// In the order of their points; empty: program time goes on while the spindle stands.
  std::span<const TorqueBandSection<Real>> sections;
  /// What else the program asks for there: one a point, or none at all.
  std::span<const ExpectedCut<Real>> cuts = {};
  /// One a point, or none at all.
  std::span<const TorqueBandChange<Real>> changes = {};
  /// Of each engagement that the cuts name; or none at all, and teeth are not counted.
  std::span<const ToothLines<Real>> lines = {};
};

}  // namespace servosense
