// Whether the range of a channel fits a signal.
#pragma once

#include <cstddef>
#include <span>

namespace servosense::impact {

/// Step of the converter [unit of x]: the smallest difference of two values, if all others are
/// whole multiples of it; else 0.
[[nodiscard]] double smallest_step(std::span<const double> x);

/// Whether the highest samples of `sign` x are those of no smooth signal that dies away: at least
/// three in a row within a step, or within noise, of the top, from which it falls off too steeply;
/// or several swings that end within a step of the same value. `noise`: standard deviation of a
/// sample.
[[nodiscard]] bool cut_off(std::span<const double> x, double sign, double step, double noise);

}  // namespace servosense::impact
