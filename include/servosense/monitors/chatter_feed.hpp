// What the feed of the axes says about a verdict on chatter (chatter.hpp).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "servosense/core/real_time.hpp"

namespace servosense {

/// Whether the axes feed evenly, from where they are once a revolution: by amounts within a tenth
/// of each other over the last five. When the feed changes so do the chips, and where it stands the
/// teeth take turns at what their throw has left over.
template <RealNumber Real>
struct ChatterFeed {
  static constexpr Real kStanding_m2 = Real(1e-12);  ///< a micrometre a revolution
  static constexpr Real kEven = Real(0.81);          ///< within a tenth, squared
  /// Standing for so long, something else feeds.
  static constexpr std::uint32_t kPatience = 64;

  std::array<Real, 3> position_m{};
  std::array<Real, 5> travel_m2{};     ///< squares, of the last revolutions, newest first
  std::uint32_t standing = kPatience;  ///< revolutions, up to kPatience
  bool told = false;

  void take(const std::array<Real, 3>& now_m) noexcept {
    Real sum = 0;
    for (std::size_t i = 0; i < now_m.size(); ++i) {
      const Real d = now_m[i] - position_m[i];
      sum += d * d;
    }
    position_m = now_m;
    for (std::size_t i = travel_m2.size() - 1; i > 0; --i) travel_m2[i] = travel_m2[i - 1];
    travel_m2[0] = told ? sum : Real(0);
    told = true;
    if (travel_m2[0] > kStanding_m2)
      standing = 0;
    else if (standing < kPatience)
      ++standing;
  }
  [[nodiscard]] bool steady() const noexcept {
    if (standing > 0) return standing == kPatience;
    Real least = travel_m2[0];
    Real most = travel_m2[0];
    for (const Real t : travel_m2) {
      if (t < least) least = t;
      if (t > most) most = t;
    }
    return least >= kEven * most;
  }
};

}  // namespace servosense
