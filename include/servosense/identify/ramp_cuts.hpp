// What a ramp that was evaluated (stable_speeds.hpp) says of cuts at single speeds, as evidence for
// the map of stability (watched_cuts.hpp).
//
// Unstable: where between two stable speeds the power of the chatter has its maximum. There it
// neither grows nor dies away although it leaves the work, so the linear cut grows. A maximum at
// the end of such a stretch is none: chatter of the lobe before rings there.
// Stable: a stable speed about which chatter falls below a hundredth of the strongest power, a
// tenth of its height. Were no speed there stable, it would hold itself higher: its height goes as
// the root of the depth beyond the limit. Where it does not fall so far nothing is said: the pocket
// is the best speed, and the cut may be too deep even there.
// Bad at: the tenth is of chatter that the torque shows; what the feed hides is not asked.
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
