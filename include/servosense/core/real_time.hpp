// Annotations for code that runs at the servo rate, and the guard that keeps NaN checks alive.
//
// SERVOSENSE_NONBLOCKING marks a function that neither allocates, locks nor calls the system.
// clang 20 and newer check the promise (at compile time with -Wfunction-effects, at run time with
// -fsanitize=realtime); other compilers see nothing.
#pragma once

#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "servosense needs NaN and Inf: build without -ffast-math and -ffinite-math-only"
#endif

#if defined(__clang__) && __clang_major__ >= 20
#define SERVOSENSE_NONBLOCKING noexcept [[clang::nonblocking]]
#else
#define SERVOSENSE_NONBLOCKING noexcept
#endif

#include <concepts>

namespace servosense {

/// The number type of a real-time block: float in firmware, float or double on a host.
template <typename T>
concept RealNumber = std::same_as<T, float> || std::same_as<T, double>;

/// True for a number that is neither NaN nor infinite. Written as a comparison that NaN fails, so
/// it costs two instructions and needs no library.
template <RealNumber Real>
[[nodiscard]] constexpr bool is_finite(Real value) noexcept {
  return value - value == Real(0);
}

/// True for a number that filters can take without overflowing: its square is finite.
template <RealNumber Real>
[[nodiscard]] constexpr bool is_moderate(Real value) noexcept {
  return is_finite(value * value);
}

}  // namespace servosense
