// Decaying sinusoids in a stretch of a signal: step 3 and 4 of free_decay.hpp.
#pragma once

#include <cstddef>
#include <vector>

#include "servosense/identify/idle.hpp"

namespace servosense::free_decay {

/// A stretch of regular samples.
struct Stretch {
  std::vector<double> value;
  std::vector<double> turns;  ///< of the spindle; empty: unknown
  double period_s = 0;
  std::size_t quiet = 0;  ///< sample from which on nothing but forced lines and noise was heard
};

struct Pole {
  Estimate decay_per_s;
  Estimate frequency_hz;  ///< of the oscillation
  Estimate natural_frequency_hz;
  Estimate damping_ratio;
};

struct DecayFit {
  std::vector<Pole> poles;
  std::vector<double> fitted;
  double noise = 0;    ///< rms of what is left in the later half of the quiet
  bool holds = false;  ///< what is left before it is no more than that
};

/// Multiples of the rotation that stand in the quiet; none while the rotation is unknown.
std::vector<int> forced_lines(const Stretch& s);

/// Decays within the band, of the samples from `from` on; times count from there.
DecayFit fit_decays(const Stretch& s, std::size_t from, const std::vector<int>& forced,
                    double from_hz, double to_hz);

}  // namespace servosense::free_decay
