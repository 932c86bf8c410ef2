// Moving extremes: the tolerance in time of a torque band (Bertok 1984, section 5.4.1).
#pragma once

#include <cstddef>
#include <deque>
#include <vector>

namespace servosense {

/// Greatest value within [i - behind, i + ahead], each point entering and leaving the queue once.
inline std::vector<double> greatest_around(const std::vector<double>& x, std::size_t behind,
                                           std::size_t ahead) {
  std::vector<double> out(x.size());
  std::deque<std::size_t> falling;
  std::size_t next = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    for (; next < x.size() && next <= i + ahead; ++next) {
      while (!falling.empty() && x[falling.back()] <= x[next]) falling.pop_back();
      falling.push_back(next);
    }
    while (falling.front() + behind < i) falling.pop_front();
    out[i] = x[falling.front()];
  }
  return out;
}
/// Smallest, likewise.
inline std::vector<double> smallest_around(std::vector<double> x, std::size_t behind,
                                           std::size_t ahead) {
  for (double& v : x) v = -v;
  x = greatest_around(x, behind, ahead);
  for (double& v : x) v = -v;
  return x;
}

}  // namespace servosense
