// Measuring time per call: a mean with the loop's own cost taken out, percentiles of single calls
// with the clock's own cost taken out, and a cost law fitted to a sweep.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <vector>

#if defined(__x86_64__)
#include <x86intrin.h>
#endif

namespace bench {

/// Keeps the compiler from dropping the work that `value` came from.
template <typename T>
inline void keep(const T& value) {
  asm volatile("" : : "m"(value) : "memory");
}

using Clock = std::chrono::steady_clock;

inline double ns_since(Clock::time_point start) {
  return std::chrono::duration<double, std::nano>(Clock::now() - start).count();
}

/// ns per sample of `pass`, which works through `samples` samples: the least of many repeats, since
/// whatever disturbs a measurement only ever adds to it.
template <typename Pass>
double least_ns_per_sample(std::size_t samples, double budget_ms, Pass pass) {
  pass();
  double least = 1e300;
  const auto start = Clock::now();
  int repeats = 0;
  do {
    const auto begin = Clock::now();
    pass();
    least = std::min(least, ns_since(begin));
  } while (++repeats < 5 || ns_since(start) < budget_ms * 1e6);
  return least / static_cast<double>(samples);
}

/// Reading of the finest counter there is.
inline std::uint64_t counter() {
#if defined(__x86_64__)
  unsigned core = 0;
  const std::uint64_t value = __rdtscp(&core);
  _mm_lfence();
  return value;
#else
  return static_cast<std::uint64_t>(Clock::now().time_since_epoch().count());
#endif
}

inline double ns_per_count() {
  const auto start = Clock::now();
  const std::uint64_t before = counter();
  while (ns_since(start) < 2e7) {
  }
  return ns_since(start) / static_cast<double>(counter() - before);
}

/// Single calls: how long the slowest of ten thousand, and the slowest of all took.
struct Tail {
  double p9999_ns = 0;
  double worst_ns = 0;
};

template <typename Call>
Tail tail_of_calls(std::size_t calls, double ns_per_count, Call call) {
  std::vector<std::uint64_t> counts(calls);
  for (std::size_t i = 0; i < calls; ++i) {
    const std::uint64_t before = counter();
    call(i);
    counts[i] = counter() - before;
  }
  const auto at = counts.begin() + static_cast<std::ptrdiff_t>(calls - 1 - calls / 10000);
  std::nth_element(counts.begin(), at, counts.end());
  const auto worst = std::max_element(at, counts.end());
  return {static_cast<double>(*at) * ns_per_count, static_cast<double>(*worst) * ns_per_count};
}

/// What two readings of the counter with nothing between them are apart, usually.
inline double counter_cost_ns(double ns_per_count) {
  std::vector<std::uint64_t> counts(10001);
  for (std::uint64_t& c : counts) {
    const std::uint64_t before = counter();
    c = counter() - before;
  }
  std::nth_element(counts.begin(), counts.begin() + 5000, counts.end());
  return static_cast<double>(counts[5000]) * ns_per_count;
}

/// y = fixed + per_unit x by least squares on relative errors, so that small sizes count too.
struct Law {
  double fixed = 0;
  double per_unit = 0;
};

inline Law fit(const std::vector<double>& x, const std::vector<double>& y) {
  double s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double w = 1 / (y[i] * y[i]);
    s += w;
    sx += w * x[i];
    sy += w * y[i];
    sxx += w * x[i] * x[i];
    sxy += w * x[i] * y[i];
  }
  const double slope = (s * sxy - sx * sy) / (s * sxx - sx * sx);
  return {(sy - slope * sx) / s, slope};
}

}  // namespace bench
