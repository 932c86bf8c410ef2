// Phase 2: what feed and speed make of an engagement. Needs no geometry again.
#pragma once

#include <cmath>

#include "servosense/process/engagement/engagement.hpp"
#include "servosense/process/program/canonical_move.hpp"

namespace servosense::process {

/// Feed per tooth of a move [m]; NaN where the spindle stands, the teeth are not known or the move
/// is a rapid.
[[nodiscard]] inline double feed_per_tooth_m(const CanonicalMove& move, int teeth) {
  if (teeth <= 0) return kNoAngle;
  if (move.feed_m_rev > 0) return move.feed_m_rev / teeth;
  const double teeth_per_s = std::abs(move.spindle_rpm) / 60 * teeth;
  return move.feed_m_s > 0 && teeth_per_s > 0 ? move.feed_m_s / teeth_per_s : kNoAngle;
}

/// Where the teeth enter and leave, in the sense of rotation: of several arcs the first entry and
/// the last exit. NaN without contact.
struct EntryExit {
  double entry_deg = kNoAngle, exit_deg = kNoAngle;
};
/// `clockwise` seen from above, as with M3.
[[nodiscard]] inline EntryExit entry_exit(const Engagement& engagement, bool clockwise) {
  if (engagement.arcs.empty()) return {};
  const double first = engagement.arcs.front().from_deg, last = engagement.arcs.back().to_deg;
  return clockwise ? EntryExit{first, last} : EntryExit{last, first};
}

}  // namespace servosense::process
