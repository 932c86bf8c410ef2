// The load from which on a tool cuts, from the loads of records that hold cuts and mostly air, too.
#pragma once

#include <vector>

namespace servosense {

/// `loads`: mean magnitudes of an effort, one a short stretch, in any order. `border`: the load of
/// each record at its lighter end. The logarithms of loads lie in hills, one a state of the
/// machine; the lightest is air when a valley parts it from the next and most records begin or end
/// in it. The level lies in that valley, half as much again as the air at most. 0 where there is no
/// air.
[[nodiscard]] double cutting_level_of(std::vector<double> loads, const std::vector<double>& border);

}  // namespace servosense
