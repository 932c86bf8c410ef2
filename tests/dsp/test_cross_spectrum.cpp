// Cross spectra against a direct transform, and the variance that half overlap leaves to them.
#include <cmath>
#include <complex>
#include <numeric>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/cross_spectrum.hpp"
#include "servosense/dsp/power_spectrum.hpp"

namespace {

using servosense::cross_spectrum;
using servosense::CrossSpectrum;
using servosense::kTwoPi;
using Complex = std::complex<double>;

std::vector<double> noise(std::size_t n, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<double> x(n);
  for (double& v : x) v = normal(random);
  return x;
}

Complex direct(const std::vector<double>& x, std::size_t start, std::size_t n, std::size_t line) {
  double mean = 0;
  for (std::size_t i = 0; i < n; ++i) mean += x[start + i] / static_cast<double>(n);
  Complex sum = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double turn = kTwoPi * static_cast<double>(i) / static_cast<double>(n);
    sum += (x[start + i] - mean) * (0.5 - 0.5 * std::cos(turn)) *
           std::polar(1.0, -turn * static_cast<double>(line));
  }
  return sum;
}

void direct_transform() {
  constexpr std::size_t kSegment = 32;
  const auto x = noise(100, 1), y = noise(100, 2);
  for (const std::ptrdiff_t delay : {0, 5, -7}) {
    const CrossSpectrum s = cross_spectrum(x, y, kSegment, delay);
    const std::size_t late = delay > 0 ? static_cast<std::size_t>(delay) : 0;
    const std::size_t early = delay < 0 ? static_cast<std::size_t>(-delay) : 0;
    const std::size_t count = (100 - late - early - kSegment) / 16 + 1;
    CHECK(s.whole.segments == count);
    CHECK(s.parts.size() == count);
    for (std::size_t m = 0; m <= kSegment / 2; ++m) {
      Complex cross = 0;
      double input = 0, output = 0;
      for (std::size_t k = 0; k < count; ++k) {
        const Complex a = direct(x, early + 16 * k, kSegment, m);
        const Complex b = direct(y, late + 16 * k, kSegment, m);
        cross += std::conj(a) * b, input += std::norm(a), output += std::norm(b);
      }
      CHECK_NEAR(std::abs(s.whole.cross[m] - cross), 0, 1e-10);
      CHECK_NEAR(s.whole.input[m], input, 1e-10);
      CHECK_NEAR(s.whole.output[m], output, 1e-10);
    }
  }
}

// The parts are the whole; auto spectra are those of the power spectrum.
void parts_and_power() {
  constexpr std::size_t kSegment = 64;
  const auto x = noise(5000, 3), y = noise(5000, 4);
  const CrossSpectrum s = cross_spectrum(x, y, kSegment, 0, 10);
  CHECK(s.parts.size() == 10);
  servosense::CrossSums sum;
  for (const auto& part : s.parts) sum += part;
  CHECK(sum.segments == s.whole.segments);
  servosense::PowerSpectrum power(kSegment, 1000);
  for (const double v : x) power.add(v);
  CHECK(power.segments() == s.whole.segments);
  const auto p = power.power();
  for (std::size_t m = 1; m < kSegment / 2; ++m) {
    CHECK_NEAR(std::abs(sum.cross[m] - s.whole.cross[m]), 0, 1e-9);
    CHECK_NEAR(s.whole.input[m] * 2 / (s.noise_gain * kSegment * static_cast<double>(sum.segments)),
               p[m], 1e-12);
  }
}

// Of an input that is the same in every segment, and of one that is not, the cross spectrum with
// noise has the variance that `overlap` says, over seeds.
void overlap_counts() {
  constexpr std::size_t kSegment = 32, kLine = 7, kSamples = 352;
  for (const bool periodic : {true, false}) {
    double seen = 0, said = 0;
    for (unsigned seed = 0; seed < 4000; ++seed) {
      auto x = noise(kSamples, 10000 + seed);
      if (periodic)
        for (std::size_t i = 0; i < kSamples; ++i)
          x[i] = std::cos(kTwoPi * kLine / kSegment * static_cast<double>(i));
      const CrossSpectrum s = cross_spectrum(x, noise(kSamples, 20000 + seed), kSegment);
      seen += std::norm(s.whole.cross[kLine]);
      said += s.overlap[kLine] * s.noise_gain * s.whole.input[kLine];
    }
    // The mean square of 4000 complex normal numbers is known to 1.6 %.
    CHECK_NEAR(seen / said, 1, 0.05);
  }
}

}  // namespace

int main() {
  direct_transform();
  parts_and_power();
  overlap_counts();
  return check::done();
}
