// The period of a record's rows, of time stamps with jitter, rounding and holes.
#include <cmath>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/io/sample_period.hpp"

namespace {

using servosense::sample_period;

/// Rows of a rate, each stamp as `stamp` makes it of the true time.
template <typename Stamp>
std::vector<double> rows(double rate_hz, int count, Stamp&& stamp) {
  std::vector<double> times;
  for (int i = 0; i < count; ++i) times.push_back(stamp(i / rate_hz));
  return times;
}

}  // namespace

int main() {
  std::mt19937 random(21);
  std::normal_distribution<double> normal;
  CHECK(sample_period({}) == 0);
  CHECK(sample_period(std::vector{3.0}) == 0);
  CHECK(sample_period(std::vector{3.0, 3.5}) == 0.5);
  CHECK_NEAR(sample_period(rows(8000, 512, [](double t) { return t; })), 125e-6, 1e-12);
  // Rounded to milliseconds, a third of them 4 ms apart and the others 3: over n rows the rounding
  // is a millisecond at most, so 1 / n ms of the mean step.
  CHECK_NEAR(sample_period(rows(300, 512, [](double t) { return std::round(1e3 * t) / 1e3; })),
             1.0 / 300, 1e-3 / 256);
  CHECK_NEAR(sample_period(rows(1000, 512, [&](double t) { return t + 2e-4 * normal(random); })),
             1e-3, 6 * 2e-4 / 256);
  // A tenth of the rows are missing, and twice a second of them.
  std::vector<double> times = rows(500, 2000, [](double t) { return t; });
  std::erase_if(times, [&](double t) {
    return normal(random) > 1.28 || (t > 1 && t < 2) || (t > 3 && t < 3.5);
  });
  CHECK_NEAR(sample_period(times), 2e-3, 1e-9);
  return check::done();
}
