// What the feed of the axes says about a verdict on chatter (chatter.hpp).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"

namespace servosense {

/// How evenly the axes feed, from where they are once a revolution: by what part the slowest of the
/// last five feeds less than the fastest. When the feed changes by a part so do the chips, and the
/// square of that part of the load is the cut's own; where it stands the teeth take turns at what
/// their throw has left over. Even: within 7 %.
template <RealNumber Real>
struct ChatterFeed {
  static constexpr Real kStanding_m2 = Real(1e-12);  ///< a micrometre a revolution
  static constexpr Real kEven = Real(0.0049);        ///< 7 %, squared
  /// Standing for so long, something else feeds.
  static constexpr std::uint32_t kPatience = 64;

  std::array<Real, 3> position_m{};
  std::array<Real, 5> pace_m2{};       ///< way a sample, squared, of the last ones, newest first
  std::uint32_t standing = kPatience;  ///< revolutions, up to kPatience
  Real uneven = 0;                     ///< that part, squared
  bool told = false;

  /// Where the axes are, and samples since that was told last: a revolution, to a sample.
  void take(const std::array<Real, 3>& now_m, std::uint32_t samples) noexcept {
    Real way_m2 = 0;
    for (std::size_t i = 0; i < now_m.size(); ++i) {
      const Real d = now_m[i] - position_m[i];
      way_m2 += d * d;
    }
    if (!told) way_m2 = 0;
    told = true;
    position_m = now_m;
    for (std::size_t i = pace_m2.size() - 1; i > 0; --i) pace_m2[i] = pace_m2[i - 1];
    const auto n = static_cast<Real>(samples > 0 ? samples : 1);
    pace_m2[0] = way_m2 / (n * n);
    if (way_m2 > kStanding_m2)
      standing = 0;
    else if (standing < kPatience)
      ++standing;
    uneven = standing == 0 ? apart() : standing == kPatience ? Real(0) : Real(1);
  }
  [[nodiscard]] bool steady() const noexcept { return uneven <= kEven; }

 private:
  [[nodiscard]] Real apart() const noexcept {
    Real least = pace_m2[0];
    Real most = pace_m2[0];
    for (const Real t : pace_m2) {
      if (t < least) least = t;
      if (t > most) most = t;
    }
    const Real part = Real(1) - std::sqrt(least / most);
    return part * part;
  }
};

}  // namespace servosense
