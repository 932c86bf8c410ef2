// Sliced transform against a direct one in double, and its slices counted.
#include <cmath>
#include <complex>
#include <limits>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/sliced_fourier.hpp"

namespace {

using namespace servosense;

template <typename Real, std::uint32_t Points>
void against_direct(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  static SlicedFourier<Real, Points> block;
  block.reset();
  CHECK(block.idle());
  CHECK(!block.step([](std::uint32_t) { return Real(1); }));
  for (int pass = 0; pass < 2; ++pass) {
    std::vector<Real> x(Points);
    for (std::uint32_t n = 0; n < Points; ++n)
      x[n] = static_cast<Real>(normal(random) + 3 * std::cos(kTwoPi * 7.3 * n / Points) + 2);
    block.begin();
    std::uint32_t slices = 1, asked = 0;
    while (!block.step([&](std::uint32_t n) {
      CHECK(n == asked++);
      return x[n];
    }))
      ++slices;
    CHECK(slices == (SlicedFourier<Real, Points>::kSlices));
    CHECK(asked == Points && block.idle());
    double largest = 0, worst = 0;
    for (std::uint32_t k = 0; k <= Points / 2; ++k) {
      std::complex<double> sum = 0;
      for (std::uint32_t n = 0; n < Points; ++n)
        sum += static_cast<double>(x[n]) * (0.5 - 0.5 * std::cos(kTwoPi * n / Points)) *
               std::polar(1.0, -kTwoPi * (n * k % Points) / Points);
      largest = std::max(largest, std::norm(sum));
      worst = std::max(worst, std::abs(std::norm(sum) - static_cast<double>(block.power(k))));
    }
    // A rounding for each of the stages, and those of window and table.
    CHECK(worst < 20 * static_cast<double>(std::numeric_limits<Real>::epsilon()) * largest);
  }
}

// Sinusoid on a line: (A N / 4)^2. White noise: 3/8 N v in the mean.
void scale() {
  static SlicedFourier<double, 512> block;
  const auto run = [&](auto&& x) {
    block.begin();
    while (!block.step(x)) {
    }
  };
  run([](std::uint32_t n) { return 3 * std::cos(kTwoPi * 40 * n / 512 + 1); });
  CHECK_NEAR(block.power(40), std::pow(3 * 512 / 4, 2), 1e-6);
  CHECK_NEAR(block.power(45), 0, 1e-18 * std::pow(3 * 512, 2));
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  double sum = 0;
  for (int pass = 0; pass < 40; ++pass) {
    run([&](std::uint32_t) { return 2 * normal(random); });
    for (std::uint32_t k = 2; k < 254; ++k) sum += block.power(k);
  }
  // 40 * 252 powers, each known to its own size; neighbours share two thirds.
  CHECK_NEAR(sum / (40 * 252) / (0.375 * 512 * 4), 1, 0.06);
}

}  // namespace

int main() {
  against_direct<float, 64>(1);
  against_direct<float, 512>(2);
  against_direct<double, 512>(3);
  against_direct<double, 1024>(4);
  scale();
  return check::done();
}
