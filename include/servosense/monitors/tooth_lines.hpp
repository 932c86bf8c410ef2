// How strongly the torque of a cutter pulses, by multiples of the spindle's speed.
#pragma once

#include <array>
#include <cstddef>

#include "servosense/core/real_time.hpp"

namespace servosense {

/// Multiples of the spindle's speed that are looked at.
inline constexpr std::size_t kToothLines = 12;

/// Of one engagement: half the amplitude at k + 1 times the spindle's speed over the mean, of a
/// cutter with k + 1 teeth that cut alike. 0: too little to be seen, or not known.
template <RealNumber Real>
struct ToothLines {
  std::array<Real, kToothLines> share{};
};

}  // namespace servosense
