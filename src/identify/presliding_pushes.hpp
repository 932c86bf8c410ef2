// The pushes of a drive that does not slide, and the readings in them that are known best.
#pragma once

#include <cstddef>
#include <vector>

#include "idle_regression.hpp"
#include "servosense/identify/idle.hpp"

namespace servosense::presliding {

using idle_fit::Column;

// Each limit with its kind.
constexpr double kReversal = 0.05;  // chosen: of the range of the effort, and it has reversed

/// Samples from one reversal of the effort to the next.
struct Push {
  std::size_t from = 0, to = 0;
  double sense = 1;
};

/// Readings of a push: where they change, the position half way, and the effort there.
struct Points {
  Column motion, effort;
  double sense = 1;
};

/// What of a record can be trusted.
struct Pushed {
  Column position, effort;  // against friction, smoothed
  std::size_t half_mean = 0;
  double range = 0, noise = 0;  // of the effort; what smoothing leaves
};

/// Position and effort of `record`, less a constant `load`.
Pushed read_pushed(const DriveRecord& record, double load);

/// From reversal to reversal of an effort that goes back by more than `reversal`.
std::vector<Push> pushes_of(const Column& effort, double reversal);

/// Where the readings of each push change, with the effort `late` samples before; of pushes that
/// show a curvature.
std::vector<Points> points_of(const Pushed& record, const std::vector<Push>& pushes, double late);

}  // namespace servosense::presliding
