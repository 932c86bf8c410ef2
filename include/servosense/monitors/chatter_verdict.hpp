// The verdict on chatter, from what has been measured of the newest revolution.
//
// Purpose: the part of the chatter monitor (chatter.hpp, with the equations) that decides. It
// stands alone so that what would have been heard of another torque (sees_from.hpp) is judged by
// the same rule.
// Equation, a revolution n:
//   beyond_n  = max(0, beyond change - max(share, uneven feed) * load), a quarter of it while
//               nothing is cut
//   chatter_n = min(beyond_n, 2 beyond_(n-1))
// Delay: none. Cost on Cortex-M4F, range, numerical bound: those of the chatter monitor.
// Bad at: see there.
#pragma once

#include <array>
#include <cstdint>

#include "servosense/core/real_time.hpp"

namespace servosense {

/// What has raised or ended an alarm or warning of the chatter monitor, each with a threshold of
/// its own.
enum class ChatterSign : std::uint8_t {
  power,   ///< of all that does not repeat with the revolution [Nm^2]
  forced,  ///< power that does repeat [Nm^2]; warns at most
  line,    ///< score of the strongest line; alarms at once
};

/// The newest revolution [Nm^2]; all but mean and feed are mean squares of it.
template <RealNumber Real>
struct ChatterMeasures {
  Real beyond_change = 0;      ///< of the comb, or a change that lasts where teeth are not known
  Real remembered = 0;         ///< load: largest mean square of the torque, with what has faded
  std::array<Real, 3> load{};  ///< mean square of the torque, newest revolution first
  Real mean_Nm = 0;            ///< mean torque
  Real uneven_feed = 0;        ///< part by which the feed differs (chatter_feed.hpp), squared
};

template <RealNumber Real>
struct ChatterRule {
  static constexpr Real kGrowth = 2;           // of a verdict against the one before
  static constexpr Real kMemory = Real(0.98);  // part of the load that is left after a revolution
  static constexpr Real kTouch = Real(0.3);
  static constexpr Real kAir = Real(0.25);  // what counts of a power while nothing is cut

  Real share = 0;       ///< of the load that is left to the cut
  Real cutting_Nm = 0;  ///< mean torque that means cutting; 0: every one does

  /// The load that is remembered after a revolution with this one.
  [[nodiscard]] static Real remember(Real load, Real remembered) noexcept {
    const Real faded = kMemory * remembered;
    return load > faded ? load : faded;
  }
  /// The load has risen to more than three times within the three revolutions that the comb
  /// compares: the first teeth are in the work, or all that differs is that they were not before.
  [[nodiscard]] static bool touches(const std::array<Real, 3>& load) noexcept {
    const Real least = kTouch * load[0];
    return load[1] < least || load[2] < least;
  }
  [[nodiscard]] bool cuts(Real mean_Nm) const noexcept {
    return (mean_Nm < 0 ? -mean_Nm : mean_Nm) >= cutting_Nm;
  }
  /// Power that neither a change of the cut or the feed nor the load explains. Without a cut there
  /// is no chatter, but there are the lines of a counter at constant speed, which lie wherever that
  /// puts them; a quarter is left for cuts too light to show.
  [[nodiscard]] Real beyond(const ChatterMeasures<Real>& m) const noexcept {
    if (touches(m.load)) return Real(0);
    const Real own = m.uneven_feed > share ? m.uneven_feed : share;  // of the load, the cut's
    const Real beyond = m.beyond_change - own * m.remembered;
    if (!(beyond > 0)) return Real(0);
    return cuts(m.mean_Nm) ? beyond : kAir * beyond;
  }
  /// What is judged: chatter grows by a factor a revolution, a jump comes out of nothing.
  [[nodiscard]] static Real judged(Real beyond, Real before) noexcept {
    const Real grown = kGrowth * before;
    return beyond < grown ? beyond : grown;
  }
};

}  // namespace servosense
