// Moving average against the mean of the last samples in long double.
#include <algorithm>
#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/dsp/moving_average.hpp"

namespace {

using namespace servosense;

template <typename Real, std::size_t Window>
void against_the_mean() {
  const unsigned seed = 5;
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> value(-100, 100);
  MovingAverage<Real, Window> block;
  std::vector<Real> x;
  long double worst = 0;
  for (std::size_t n = 0; n < 200'000; ++n) {
    x.push_back(static_cast<Real>(value(random) + 1e4));
    const std::size_t count = std::min(Window, x.size());
    long double sum = 0;
    for (std::size_t i = x.size() - count; i < x.size(); ++i) sum += static_cast<long double>(x[i]);
    worst = std::max(worst, std::abs(static_cast<long double>(block.process(x.back())) -
                                     sum / static_cast<long double>(count)));
  }
  // One rounding for each of the additions and two for the division, of numbers near N 1e4.
  const double bound =
      1.01e4 * (Window + 2) * static_cast<double>(std::numeric_limits<Real>::epsilon());
  check::near(static_cast<double>(worst), 0, bound, ("mean, seed " + std::to_string(seed)).c_str(),
              __FILE__, __LINE__);
}

template <typename Real>
void null_at_half_the_rate() {
  MovingAverage<Real, 2> two;
  two.process(Real(-3));
  for (int n = 0; n < 100; ++n) CHECK(two.process(n % 2 == 0 ? Real(3) : Real(-3)) == Real(0));
}

template <typename Real>
void faults() {
  const Real nan = std::numeric_limits<Real>::quiet_NaN();
  MovingAverage<Real, 4> block;
  CHECK(block.process(nan) == Real(0));  // nothing to repeat yet
  CHECK(block.state().held && block.state().count == 0);
  CHECK(block.process(Real(4)) == Real(4));
  CHECK(block.process(Real(8)) == Real(6));
  CHECK(block.process(std::numeric_limits<Real>::infinity()) == Real(20) / Real(3));  // 4 8 8
  CHECK(block.state().held);
  CHECK(block.process(Real(0)) == Real(5));
  CHECK(!block.state().held);
  for (int n = 0; n < 3; ++n) block.process(Real(0));
  CHECK(block.process(Real(0)) == Real(0));  // no trace of it after the window
}

}  // namespace

int main() {
  against_the_mean<float, 2>();
  against_the_mean<float, 7>();
  against_the_mean<double, 2>();
  against_the_mean<double, 16>();
  null_at_half_the_rate<float>();
  null_at_half_the_rate<double>();
  faults<float>();
  faults<double>();
  return check::done();
}
