// Order statistics of values in memory; 0 of none. Allocates: for the desk, not for `process`.
#pragma once

#include <vector>

namespace servosense {

/// Value that `share` (0 to 1) of them does not exceed, one of them.
[[nodiscard]] double quantile(std::vector<double> values, double share);
/// One of them: of an even number the upper one in the middle.
[[nodiscard]] double median(std::vector<double> values);

}  // namespace servosense
