// At which interval new values come, where a drive holds each for several samples.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace servosense {

/// Mean of the samples from one new value to the next, `apart`; 0 unless they are regular and more
/// than one.
inline double regular_interval(std::vector<std::size_t> apart) {
  constexpr std::size_t kLeast = 30;  // stretches: fewer may be alike by chance
  constexpr double kRegular = 0.95;   // of them; values that repeat by chance spread
  if (apart.size() < kLeast) return 0;
  std::nth_element(apart.begin(), apart.begin() + static_cast<std::ptrdiff_t>(apart.size() / 2),
                   apart.end());
  const std::size_t middle = apart[apart.size() / 2];
  double sum = 0, regular = 0;
  for (const std::size_t n : apart)
    if (n + 1 >= middle && n <= middle + 1) {
      sum += static_cast<double>(n);
      ++regular;
    }
  const double mean = sum / regular;
  return regular < kRegular * static_cast<double>(apart.size()) || mean < 1.5 ? 0 : mean;
}

}  // namespace servosense
