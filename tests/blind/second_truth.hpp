// How strong a hidden effect of the second generator is in its record: by a plain refit of mass,
// viscous and Coulomb friction, with the knee of the friction and the timing free.
#pragma once

#include <cstddef>

#include "second_plant.hpp"

namespace blind::second {

struct Baseline {
  double rate_hz = 1000;
  std::size_t held_out = 0;             ///< first row that is not fitted
  double small = 1e-6;                  ///< of the travels, a micrometre or its like
  double inertia = 1;                   ///< for what the encoder's steps are worth
  bool viscous = true, coulomb = true;  ///< whether the machine file has them
};

struct Gaps {
  double learnt = 0, held_out = 0;  ///< rms of what is left, in an 80 Hz band
};

Gaps refitted(const Record&, const Baseline&);

/// Rms of the noise that acts and that is read, in the same band.
double noise_floor(const Record&, const Baseline&);

}  // namespace blind::second
