// What a ramp that was evaluated (stable_speeds.hpp) says of cuts at single speeds, as evidence for
// the map of stability (watched_cuts.hpp).
//
// Unstable: where between two stable speeds the power of the chatter has its maximum. There it
// neither grows nor dies away although it leaves the work, so the linear cut grows. A maximum at
// the end of such a stretch is none: chatter of the lobe before rings there.
// Of stable cuts nothing is said: a speed that was found is the best one, and the cut may be too
// deep even there. That the chatter is weak about it does not tell: next to a harmonic of the teeth
// the torque hides it.
#pragma once

#include <vector>

#include "servosense/identify/stable_speeds.hpp"
#include "servosense/io/watched_cut.hpp"

namespace servosense {

/// Of the ramps that were used, by rising speed in each; none unless speeds were found.
/// `engagement` is what all of them have in common: all but speed, stable and chatter_hz.
[[nodiscard]] std::vector<WatchedCut> cuts_of_ramps(const StableSpeeds& found,
                                                    const WatchedCut& engagement);

}  // namespace servosense
