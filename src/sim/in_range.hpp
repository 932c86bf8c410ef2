// What every simulation asks of its numbers.
#pragma once

#include <cmath>

namespace servosense {

inline bool positive(double value) { return value > 0 && std::isfinite(value); }
inline bool not_negative(double value) { return value >= 0 && std::isfinite(value); }

}  // namespace servosense
