// The mode that explains the chatter of a ramp: steps 2 and 3 of stable_speeds.hpp.
#pragma once

#include <optional>
#include <vector>

#include "stable_speeds_ridge.hpp"

namespace servosense {

/// Misfit of a frequency drawn by lot: lobe numbers a quarter of a wave off, phases 0.8 rad.
inline constexpr double kMisfitByLot = 0.45;

struct ChatterMode {
  double frequency_hz = 0;
  double damping = 0;
  double phase_error_rad = 0;  // median
  double misfit = 0;           // geometric mean of lobe numbers and phase; the less, the better
  double older_share = 0;      // as it was fitted with
};

/// Frequency of chatter that leaves the fraction u, step 3 of the header with g = 0.
[[nodiscard]] double chatter_frequency(const ChatterMode& mode, double fraction);

/// Whole waves between two teeth at about this frequency.
[[nodiscard]] double waves_of(const ToothChatter& c, double frequency_hz);

/// Strong chatter, the fraction of which noise does not touch: it tells the lobes best.
[[nodiscard]] std::vector<ToothChatter> strong(const std::vector<ToothChatter>& chatter);

/// Fits a mode to the chatter, starting from a guess: its damping may be none. Where chatter is
/// strongest, the tool misses so much of the surface that `older_share` of the waves under a tooth
/// is that of the last tooth but one; elsewhere it is smaller as the amplitude is.
[[nodiscard]] std::optional<ChatterMode> fit_from(const std::vector<ToothChatter>& chatter,
                                                  const ChatterMode& guess, double older_share = 0);

/// A mode for each lobe number that leads to one.
[[nodiscard]] std::vector<ChatterMode> search_modes(const std::vector<ToothChatter>& chatter,
                                                    double highest_hz);

}  // namespace servosense
