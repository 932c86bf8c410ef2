// The period of a record's rows, of their time stamps.
#pragma once

#include <span>

namespace servosense {

/// In the unit of `times` [s or ns], holes, jitter and rounding among them: the median of the steps
/// over a longer and longer stretch, each divided by the periods that it is by the shorter ones.
/// 0 with fewer than two.
[[nodiscard]] double sample_period(std::span<const double> times);

}  // namespace servosense
