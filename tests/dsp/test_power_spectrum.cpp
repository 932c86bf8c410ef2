// Averaged power spectrum against closed forms: sinusoids, noise, Parseval and a direct transform.
#include <cmath>
#include <complex>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/power_spectrum.hpp"

namespace {

using servosense::kTwoPi;
using servosense::PowerSpectrum;

double sum_of(const std::vector<double>& lines) {
  return std::accumulate(lines.begin(), lines.end(), 0.0);
}
double hann(std::size_t i, std::size_t n) {
  return 0.5 - 0.5 * std::cos(kTwoPi * static_cast<double>(i) / static_cast<double>(n));
}

void frequencies() {
  const PowerSpectrum spectrum(16, 8000);
  const std::vector<double> f = spectrum.frequency_hz();
  CHECK(f.size() == 9);
  for (std::size_t k = 0; k < f.size(); ++k) CHECK_NEAR(f[k], 500.0 * static_cast<double>(k), 1e-9);
  CHECK(spectrum.segments() == 0);
  CHECK(sum_of(spectrum.power()) == 0);
}

// Amplitude A on a line: A^2/2 in all, split 1/6, 2/3, 1/6 over three lines by the Hann window.
void sinusoid_on_a_line() {
  constexpr std::size_t kSegment = 256;
  constexpr double kRate = 8000, kAmplitude = 3;
  for (const std::size_t line : {std::size_t{5}, std::size_t{20}, std::size_t{100}}) {
    PowerSpectrum spectrum(kSegment, kRate);
    const double step = kTwoPi * static_cast<double>(line) / kSegment;
    for (std::size_t i = 0; i < 2048; ++i)
      spectrum.add(kAmplitude * std::cos(step * static_cast<double>(i) + 0.7));
    CHECK(spectrum.segments() == 15);  // half overlap
    const std::vector<double> p = spectrum.power();
    const double whole = kAmplitude * kAmplitude / 2;
    CHECK_NEAR(sum_of(p), whole, 1e-12 * whole);
    CHECK_NEAR(p[line], whole * 2 / 3, 1e-12 * whole);
    CHECK_NEAR(p[line - 1], whole / 6, 1e-12 * whole);
    CHECK_NEAR(p[line + 1], whole / 6, 1e-12 * whole);
    CHECK_NEAR(p[line + 10], 0.0, 1e-20);
    CHECK_NEAR(spectrum.frequency_hz()[line], static_cast<double>(line) * 31.25, 1e-9);
  }
}

// Between two lines the sum still is A^2/2: a Hann window's square has three lines of its own, so
// only frequencies within two lines of zero or half the rate are hurt. What the mean of a segment
// takes away is the window's side lobe at zero, which falls with the third power of the distance.
void sinusoid_between_lines() {
  constexpr std::size_t kSegment = 256;
  for (const double line : {20.5, 33.3, 90.8}) {
    PowerSpectrum spectrum(kSegment, 1000);
    for (std::size_t i = 0; i < 64 * kSegment; ++i)
      spectrum.add(std::sin(kTwoPi * line / kSegment * static_cast<double>(i)));
    CHECK_NEAR(sum_of(spectrum.power()), 0.5, 1e-3);
  }
}

// At half the rate there is one line for both halves of the spectrum.
void half_the_rate() {
  PowerSpectrum spectrum(64, 1000);
  for (int i = 0; i < 640; ++i) spectrum.add(i % 2 == 0 ? 2 : -2);
  const std::vector<double> p = spectrum.power();
  CHECK_NEAR(p[32], 4 * 2.0 / 3, 1e-12);
  CHECK_NEAR(p[31], 4 * 1.0 / 3, 1e-12);
}

// A constant is no vibration.
void constant() {
  PowerSpectrum spectrum(64, 1000);
  for (int i = 0; i < 640; ++i) spectrum.add(1e6);
  CHECK_NEAR(sum_of(spectrum.power()), 0.0, 1e-12);
}

// White noise: its variance in all, and the same on every line.
void white_noise() {
  constexpr std::size_t kSegment = 128, kSamples = 1 << 18;
  constexpr unsigned kSeed = 5;
  constexpr double kSigma = 2;
  std::mt19937 random(kSeed);
  std::normal_distribution<double> normal(0, kSigma);
  PowerSpectrum spectrum(kSegment, 1000);
  double square = 0;
  for (std::size_t i = 0; i < kSamples; ++i) {
    const double x = normal(random);
    square += x * x;
    spectrum.add(x);
  }
  const std::vector<double> p = spectrum.power();
  const double variance = square / static_cast<double>(kSamples);
  // The segment's mean takes 1/128 of the power, weighted by the window 1/192 more or less.
  CHECK_NEAR(sum_of(p), variance, 0.015 * variance);
  // 4095 half overlapping segments: a line has a standard deviation of about 1.8 %; five of them.
  for (std::size_t k = 3; k < p.size() - 1; ++k)
    CHECK_NEAR(p[k], kSigma * kSigma * 2 / kSegment, 0.09 * kSigma * kSigma * 2 / kSegment);
}

// Parseval: the lines of one segment sum to the mean square of what went into the transform.
void parseval() {
  constexpr std::size_t kSegment = 64;
  constexpr unsigned kSeed = 6;
  std::mt19937 random(kSeed);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 20; ++trial) {
    PowerSpectrum spectrum(kSegment, 1000);
    std::vector<double> x(kSegment);
    for (double& v : x) spectrum.add(v = 1 + normal(random));
    CHECK(spectrum.segments() == 1);
    const double mean = sum_of(x) / kSegment;
    double square = 0, window = 0;
    for (std::size_t i = 0; i < kSegment; ++i) {
      const double w = hann(i, kSegment);
      square += (x[i] - mean) * (x[i] - mean) * w * w;
      window += w * w;
    }
    CHECK_NEAR(sum_of(spectrum.power()), square / window, 1e-12 * square);
  }
}

// Two half overlapping segments by a direct transform.
void direct_transform() {
  constexpr std::size_t kSegment = 32;
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  std::vector<double> x(kSegment * 3 / 2);
  PowerSpectrum spectrum(kSegment, 1000);
  for (double& v : x) spectrum.add(v = normal(random));
  CHECK(spectrum.segments() == 2);
  const std::vector<double> p = spectrum.power();
  double window = 0;
  for (std::size_t i = 0; i < kSegment; ++i) window += hann(i, kSegment) * hann(i, kSegment);
  for (std::size_t k = 0; k <= kSegment / 2; ++k) {
    double expected = 0;
    for (const std::size_t start : {std::size_t{0}, kSegment / 2}) {
      double mean = 0;
      for (std::size_t i = 0; i < kSegment; ++i) mean += x[start + i] / kSegment;
      std::complex<double> line = 0;
      for (std::size_t i = 0; i < kSegment; ++i)
        line += (x[start + i] - mean) * hann(i, kSegment) *
                std::polar(1.0, -kTwoPi * static_cast<double>(i * k) / kSegment);
      expected += std::norm(line) / 2;
    }
    expected *= (k == 0 || k == kSegment / 2 ? 1.0 : 2.0) / (window * kSegment);
    CHECK_NEAR(p[k], expected, 1e-12);
  }
}

// A sample that is not finite begins a new segment and leaves no trace.
void not_finite() {
  PowerSpectrum with(32, 1000), without(32, 1000);
  for (int i = 0; i < 20; ++i) with.add(1e9 * i);
  with.add(std::numeric_limits<double>::quiet_NaN());
  for (int i = 0; i < 64; ++i) {
    with.add(std::sin(0.4 * i));
    without.add(std::sin(0.4 * i));
  }
  with.add(std::numeric_limits<double>::infinity());
  CHECK(with.segments() == 3);
  const std::vector<double> a = with.power(), b = without.power();
  for (std::size_t k = 0; k < a.size(); ++k) CHECK(a[k] == b[k]);
}

}  // namespace

int main() {
  frequencies();
  sinusoid_on_a_line();
  sinusoid_between_lines();
  half_the_rate();
  constant();
  white_noise();
  parseval();
  direct_transform();
  not_finite();
  return check::done();
}
