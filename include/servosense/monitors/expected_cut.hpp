// What the program asks of the cutter where it is now, for the monitors beside the torque band.
//
// Purpose: one sample of the prediction. It lies beside the points of the torque band's reference
// and is aligned as those are, so it holds everywhere within the tolerance in time around a point:
// forces are the widest range that any moment of it has, and of an engagement is told only what all
// of it share. Forces are those of the drives (positive against positive motion), low-passed as the
// collision monitors hear them, tolerance included.
#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "servosense/core/real_time.hpp"
#include "servosense/core/servo_sample.hpp"

namespace servosense {

enum class ExpectedCutKind : std::uint8_t {
  unknown,   ///< of a stretch of it the program says nothing
  air,       ///< nothing is removed
  changing,  ///< the tool comes in, goes out, or cuts now this, now that
  steady,    ///< one engagement
};

/// Without end where it is not known.
template <RealNumber Real>
struct ForceRange {
  Real least_N = -std::numeric_limits<Real>::infinity();
  Real most_N = std::numeric_limits<Real>::infinity();
};

template <RealNumber Real>
struct ExpectedCut {
  ExpectedCutKind kind = ExpectedCutKind::unknown;
  std::uint16_t engagement = 0;  ///< which of the program's, where the kind is steady
  std::array<ForceRange<Real>, kAxes> force{};  ///< of x, y and z
};

/// Of one axis: what a collision monitor holds its force against.
template <RealNumber Real>
struct ExpectedForce {
  ForceRange<Real> force;
  bool air = false;    ///< the program removes nothing
  Real excess_Nm = 0;  ///< torque beyond the band: the cut asks for more than was expected
};

}  // namespace servosense
