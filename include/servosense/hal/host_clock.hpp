// The time of a run: Unix time at its start, and from then on as the monotonic clock goes, whatever
// becomes of the clock of the host. Stamps of the kernel are taken over by their age.
#pragma once

#include <chrono>

#include "servosense/core/units.hpp"

namespace servosense {

[[nodiscard]] inline Nanoseconds wall_clock_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

[[nodiscard]] inline Nanoseconds host_now_ns() noexcept {
  using Steady = std::chrono::steady_clock;
  const auto steady = [] {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(Steady::now().time_since_epoch())
        .count();
  };
  static const Nanoseconds offset = wall_clock_ns() - steady();
  return offset + steady();
}

/// Of a stamp by the wall clock, just read. One that is not of the last second, or from the future,
/// is of a clock that has been set meanwhile: then it is now.
[[nodiscard]] inline Nanoseconds host_time_of(Nanoseconds stamp_ns) noexcept {
  const Nanoseconds age = wall_clock_ns() - stamp_ns;
  return host_now_ns() - (age > 0 && age < kNanosecondsPerSecond ? age : 0);
}

}  // namespace servosense
