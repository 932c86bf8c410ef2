// Conversions at the border where people type rpm, degrees and mm/min. Inside, everything is SI.
#pragma once

#include <cstdint>
#include <numbers>

namespace servosense {

inline constexpr double kPi = std::numbers::pi;
inline constexpr double kTwoPi = 2.0 * std::numbers::pi;
/// Standard acceleration of free fall [m/s2].
inline constexpr double kGravity_m_s2 = 9.80665;

/// Time in servosense: signed 64-bit nanoseconds, 292 years either way, so no clock wraps.
using Nanoseconds = std::int64_t;
inline constexpr Nanoseconds kNanosecondsPerSecond = 1'000'000'000;

[[nodiscard]] constexpr double rad_s_from_rpm(double rpm) noexcept { return rpm * kTwoPi / 60.0; }
[[nodiscard]] constexpr double rpm_from_rad_s(double rad_s) noexcept {
  return rad_s * 60.0 / kTwoPi;
}
[[nodiscard]] constexpr double rad_from_deg(double deg) noexcept { return deg * kPi / 180.0; }
[[nodiscard]] constexpr double m_s_from_mm_min(double mm_min) noexcept { return mm_min / 60000.0; }
[[nodiscard]] constexpr double seconds_from(Nanoseconds t) noexcept {
  return static_cast<double>(t) / 1e9;  // correctly rounded, so that it prints short
}
[[nodiscard]] constexpr Nanoseconds nanoseconds_from(double seconds) noexcept {
  const double ns = seconds * 1e9;
  return static_cast<Nanoseconds>(ns < 0 ? ns - 0.5 : ns + 0.5);
}

/// Metres of travel per radian of a screw with this lead (Koike 2016, R = l/2pi).
[[nodiscard]] constexpr double m_per_rad(double lead_m) noexcept { return lead_m / kTwoPi; }

}  // namespace servosense
