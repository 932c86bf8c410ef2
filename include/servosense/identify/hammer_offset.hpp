// A hammer that hits above the sensor: from cross to direct receptance at the tip.
//
// The tool is taken for a cantilever that bends as under a static force (Dunwoody 2010, eq. 4.42 to
// 4.44): of stick-out L, hit l = L - offset above its root,
//   G_direct = G_cross 2 L^3 / (l^2 (3 L - l)),   one real factor for all frequencies.
// Bad at: modes of spindle and holder, in which the tool moves without bending. They come out too
// soft, by that factor at most.
#pragma once

#include "servosense/core/expected.hpp"

namespace servosense {

/// Usage error unless 0 <= offset < stick-out [m].
[[nodiscard]] Expected<double> hammer_offset_factor(double offset_m, double stick_out_m);

}  // namespace servosense
