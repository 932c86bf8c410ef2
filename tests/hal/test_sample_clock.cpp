// Clock recovery against the closed form of its loop, and against stamps whose ticks are known.
#include <cmath>
#include <cstdio>
#include <limits>
#include <random>

#include "check.hpp"
#include "servosense/hal/sample_clock.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod = 125000;
constexpr Nanoseconds kStart = 1'700'000'000'000'000'000;  // Unix time: no double holds it

SampleClock at_rest(const SampleClockConfig& config) {
  SampleClock clock(config);
  clock.start(kStart);
  for (int n = 1; n <= 400; ++n) clock.follow(1, kStart + n * 125000);  // acquired
  return clock;
}

// First order: behind a step s of the phase, e of the k-th event is s (1 - alpha)^k.
void step_of_the_phase() {
  SampleClockConfig c;
  c.rate_gain = 0;
  c.early_gain = c.late_gain = 1.0 / 16;
  for (const double step : {0.3, -0.3}) {
    SampleClock clock = at_rest(c);
    const auto offset = static_cast<Nanoseconds>(step * kPeriod);
    for (int k = 0; k < 60; ++k) {
      const Nanoseconds t = kStart + (401 + k) * 125000 + offset;
      CHECK_NEAR(clock.elapsed(t) - 1, step * std::pow(1 - 1.0 / 16, k), 1e-9);
      clock.follow(1, t);
    }
  }
}

// Rate off by d: without rate gain e tends to d / alpha before the correction, with it to zero, and
// the period to the true one.
void error_of_the_rate() {
  for (const double d : {0.002, -0.002}) {
    SampleClockConfig c;
    c.early_gain = c.late_gain = 1.0 / 16;
    for (const double beta : {0.0, 1.0 / 496}) {
      c.rate_gain = beta;
      SampleClock clock(c);
      clock.start(kStart);
      double e = 0;
      for (int n = 1; n < 4000; ++n) {
        const Nanoseconds t = kStart + std::llround(n * kPeriod * (1 + d));
        e = clock.elapsed(t) - 1;
        CHECK(clock.take(t) == 1);
      }
      CHECK_NEAR(e, beta > 0 ? 0.0 : 16 * d, 1e-4);
      CHECK_NEAR(clock.period_ns() / kPeriod - 1, beta > 0 ? d : 0.0, 1e-5);
    }
  }
}

// Jitter of up to 0.28 periods either way: every tick is found; small jitter, over lost ones too.
void jitter() {
  for (const double us : {10.0, 20.0, 35.0}) {
    std::mt19937 random(17);
    SampleClock clock;
    std::int64_t last = 0;
    std::uint64_t wrong = 0, unlocked = 0;
    clock.start(kStart);
    for (std::int64_t n = 1; n < 80000; ++n) {
      if (us < 15 && n > 500 && random() % 100 == 0) continue;
      const double u = 2.0 * (static_cast<double>(random()) / 4294967296.0) - 1;
      const Nanoseconds t = kStart + n * 125000 + std::llround(u * us * 1000);
      const std::int64_t ticks = clock.take(t);
      if (ticks != n - last) ++wrong;
      last = n;
      if (n > 500 && !clock.locked()) ++unlocked;
    }
    if (wrong + unlocked > 0)
      std::printf("  jitter %.0f us: %llu wrong, %llu unlocked\n", us,
                  static_cast<unsigned long long>(wrong),
                  static_cast<unsigned long long>(unlocked));
    CHECK(wrong == 0 && unlocked == 0);
  }
}

// What does not fit is left out three times, then believed; a wrong rate never locks.
void jumps() {
  SampleClock clock = at_rest({});
  Nanoseconds t = kStart + 400 * 125000;
  for (int k = 0; k < 3; ++k) CHECK(clock.take(t + k) == 0);
  CHECK(clock.locked());  // the last once more is no riddle
  CHECK(clock.take(t + 125000) == 1);
  for (int k = 0; k < 3; ++k) CHECK(clock.take(t - 1'000'000'000 + k * 125000) == 0);
  CHECK(clock.take(t - 1'000'000'000 + 3 * 125000) == 4);
  CHECK(!clock.locked());
  t = t - 1'000'000'000 + 3 * 125000;
  for (unsigned k = 0; k < SampleClock::kLock; ++k) CHECK(clock.take(t += 125000) == 1);
  CHECK(clock.locked());
  // Rates that the loop does not follow: it never locks far off, and never slips unnoticed.
  for (const double rate : {2.0, 1.5, 1.1, 1.05, 1.02, 0.98, 0.95, 0.9, 0.7}) {
    SampleClock other = at_rest({});
    const Nanoseconds from = kStart + 400 * 125000;
    unsigned locked = 0, unnoticed = 0;
    for (int n = 1; n < 4000; ++n) {
      const std::int64_t ticks = other.take(from + std::llround(n * kPeriod / rate));
      if (n > 500 && other.locked()) ++locked;
      if (ticks != 1 && other.locked()) ++unnoticed;
    }
    if (std::abs(rate - 1) > 0.04) CHECK(locked == 0);
    CHECK(unnoticed == 0);
  }
}

// Nothing overflows, and after any nonsense the clock comes back.
void extremes() {
  constexpr Nanoseconds kMost = std::numeric_limits<Nanoseconds>::max();
  constexpr Nanoseconds kLeast = std::numeric_limits<Nanoseconds>::min();
  for (const double period : {1.0, 125000.0, 1e18}) {
    SampleClock clock({.period_ns = period});
    clock.start(kLeast);
    for (const Nanoseconds t : {kMost, kLeast, Nanoseconds{0}, kMost, kMost, kLeast, kLeast, kLeast,
                                kLeast, kMost, kMost - 1}) {
      CHECK(std::isfinite(clock.elapsed(t)));
      CHECK(clock.take(t) >= 0);
    }
  }
  CHECK(saturated_sum(kMost, 1) == kMost && saturated_sum(kLeast, -1) == kLeast);
  CHECK(saturated_difference(kMost, -1) == kMost && saturated_difference(kLeast, 1) == kLeast);
  CHECK(saturated_product(kMost, -2) == kLeast && saturated_product(kLeast, -2) == kMost);
  CHECK(saturated_from(1e300) > 0 && saturated_from(-1e300) < 0);
  CHECK(saturated_from(std::nan("")) == 0 && saturated_from(1.5e-9) == 2);
}

}  // namespace

int main() {
  step_of_the_phase();
  error_of_the_rate();
  jitter();
  jumps();
  extremes();
  return check::done();
}
