// Which sets of effects are tried: pairs of the best, and what is found with one effect less.
#pragma once

#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "reconcile/numerics/least_squares.hpp"

namespace servosense::reconcile {

/// Of a ranking, best first, those that may be in a pair: `may(i, earlier ones)`.
template <typename May>
[[nodiscard]] std::vector<std::size_t> best_for_pairs(std::span<const std::size_t> order, May may) {
  constexpr std::size_t kMost = 6;
  std::vector<std::size_t> top;
  for (const std::size_t i : order) {
    if (top.size() == kMost) break;
    if (may(i, std::as_const(top))) top.push_back(i);
  }
  return top;
}

/// Calls with(the better one, the other) of each pair.
template <typename With>
void for_each_pair(const std::vector<std::size_t>& top, With with) {
  for (std::size_t a = 0; a < top.size(); ++a)
    for (std::size_t b = a + 1; b < top.size(); ++b) with(top[a], top[b]);
}

/// Backwards: takes out, one after the other, what later additions made needless, but for the last.
/// `less_by(i)`: mean square that the i-th of `effects` takes off beside the others. `least`: rms
/// that is worth an effect.
template <typename Effects, typename LessBy, typename TakeOut>
void prune_needless(const Effects& effects, double least, LessBy less_by, TakeOut take_out) {
  for (std::size_t i = 0; i < effects.size() && effects.size() > 1;)
    if (root(less_by(i)) < least)
      take_out(i);
    else
      ++i;
}

}  // namespace servosense::reconcile
