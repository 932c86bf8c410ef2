// Poles of rising order, and those that come back: steps 1 and 2 a of identify/modes.hpp.
#pragma once

#include <functional>
#include <vector>

#include "modes_lines.hpp"

namespace servosense::modes {

struct OrderPoles {
  int order = 0;
  std::vector<Pole> poles;   // damped, of positive frequency
  std::vector<bool> stable;  // comes back from the order below
};

/// Of the orders 1..highest.
[[nodiscard]] std::vector<OrderPoles> poles_by_order(const std::vector<Lines>& lines, int highest,
                                                     const std::function<void(double)>& progress);

struct Candidate {
  Pole pole;       // median over its orders
  int first = 0;   // order in which it appears
  int orders = 0;  // in which it was found
};

/// Poles that are found in several orders, each once; marks the stable ones of `orders`.
[[nodiscard]] std::vector<Candidate> candidates_of(std::vector<OrderPoles>& orders);

}  // namespace servosense::modes
