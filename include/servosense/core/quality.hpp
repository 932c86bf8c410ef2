// Quality flags that travel with every sample.
#pragma once

#include <cstdint>

namespace servosense {

/// What is known against a sample. `held` alone is legal (a slower channel between two updates),
/// and `doubtful` not yet a fault; everything else is one that a monitor must not take for a
/// cutting event.
enum class Quality : std::uint16_t {
  good = 0,
  held = 1U << 0U,        ///< no new value at this instant; the last one is repeated
  invalid = 1U << 1U,     ///< NaN, Inf, or marked invalid by the source
  missing = 1U << 2U,     ///< the sample never arrived; a stand-in is used
  gap = 1U << 3U,         ///< samples were lost just before this one
  duplicate = 1U << 4U,   ///< the same instant twice
  reordered = 1U << 5U,   ///< older than its predecessor
  late = 1U << 6U,        ///< arrived after its servo period had passed
  stuck = 1U << 7U,       ///< repeats a value longer than the signal can
  jump = 1U << 8U,        ///< moved further than the drive can
  saturated = 1U << 9U,   ///< at the end of the sensor's or drive's range
  dead_bus = 1U << 10U,   ///< nothing at all has arrived for longer than the source allows
  restarted = 1U << 11U,  ///< windows and filters were emptied here; results settle anew
  settling = 1U << 12U,   ///< the block has not yet seen as many samples as it needs
  doubtful = 1U << 13U,   ///< may be wrong, as the next values will tell: no verdict yet
  stale = 1U << 14U,      ///< no new effort for longer than the drive takes between two
};

[[nodiscard]] constexpr Quality operator|(Quality a, Quality b) noexcept {
  return static_cast<Quality>(static_cast<std::uint16_t>(a) | static_cast<std::uint16_t>(b));
}
[[nodiscard]] constexpr Quality operator&(Quality a, Quality b) noexcept {
  return static_cast<Quality>(static_cast<std::uint16_t>(a) & static_cast<std::uint16_t>(b));
}
constexpr Quality& operator|=(Quality& a, Quality b) noexcept { return a = a | b; }

/// True when `flags` holds any of `wanted`.
[[nodiscard]] constexpr bool has(Quality flags, Quality wanted) noexcept {
  return (flags & wanted) != Quality::good;
}

/// The flags that make a value unusable, so that the last good one must stand in for it.
inline constexpr Quality kUnusable = Quality::invalid | Quality::missing | Quality::duplicate |
                                     Quality::reordered | Quality::late | Quality::stuck |
                                     Quality::jump | Quality::dead_bus | Quality::stale;

/// Name of a single flag; "" for anything else.
[[nodiscard]] constexpr const char* name_of(Quality flag) noexcept {
  switch (flag) {
    case Quality::good:
      return "good";
    case Quality::held:
      return "held";
    case Quality::invalid:
      return "invalid";
    case Quality::missing:
      return "missing";
    case Quality::gap:
      return "gap";
    case Quality::duplicate:
      return "duplicate";
    case Quality::reordered:
      return "reordered";
    case Quality::late:
      return "late";
    case Quality::stuck:
      return "stuck";
    case Quality::jump:
      return "jump";
    case Quality::saturated:
      return "saturated";
    case Quality::dead_bus:
      return "dead-bus";
    case Quality::restarted:
      return "restarted";
    case Quality::settling:
      return "settling";
    case Quality::doubtful:
      return "doubtful";
    case Quality::stale:
      return "stale";
  }
  return "";
}

}  // namespace servosense
