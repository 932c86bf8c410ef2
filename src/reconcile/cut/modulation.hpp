// A cut whose force rises and falls with a period of its own, that of neither turn nor tooth:
// something modulates it. Averages over turns take that for scatter, and the floor with it.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "servosense/reconcile/criteria.hpp"

namespace servosense::reconcile {

/// By how much more than the model says one tooth has cut, of its force.
struct ToothGain {
  long pass = 0;         ///< teeth that have passed before
  std::size_t kind = 0;  ///< those of one kind have cut alike: the same tooth at the same feed
  bool held_out = false;
  double gain = 0;
};

struct Modulation {
  double passes = 0;     ///< teeth that pass in a period
  double amplitude = 0;  ///< of the force
};

/// The line that stands out of the gains, of `least` amplitude or more, and is there again where it
/// was not looked for.
[[nodiscard]] std::optional<Modulation> find_modulation(std::vector<ToothGain> gains, int teeth,
                                                        double least, const Criteria& criteria);

}  // namespace servosense::reconcile
