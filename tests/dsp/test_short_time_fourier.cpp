// Offline short-time Fourier transform: direct sums, Parseval, chirps, refusals.
#include <cmath>
#include <complex>
#include <limits>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/short_time_fourier.hpp"

using namespace servosense;

namespace {

// Every frame against the sum of its definition, with a window and detrending written anew.
void equals_the_direct_sum() {
  std::mt19937 noise(11);
  std::vector<double> x;
  for (int i = 0; i < 90; ++i) x.push_back(static_cast<double>(noise()) / 1e9 + 0.05 * i + 3);
  for (const std::size_t points : {std::size_t{24}, std::size_t{24 * 2}, std::size_t{31}}) {
    const ShortTimeFourierConfig config{24, 7, points, WindowShape::hann, Detrend::line};
    const auto result = short_time_fourier(x, 100, config);
    CHECK(result.has_value());
    CHECK(result->frames() == 10);
    CHECK(result->lines() == points / 2 + 1);
    double worst = 0;
    for (std::size_t f = 0; f < result->frames(); ++f) {
      // Least squares line by the normal equations.
      double s0 = 0, s1 = 0, s2 = 0, y0 = 0, y1 = 0;
      for (std::size_t i = 0; i < 24; ++i) {
        const double t = static_cast<double>(i), y = x[7 * f + i];
        s0 += 1, s1 += t, s2 += t * t, y0 += y, y1 += t * y;
      }
      const double slope = (s0 * y1 - s1 * y0) / (s0 * s2 - s1 * s1);
      const double offset = (y0 - slope * s1) / s0;
      double squares = 0;
      for (std::size_t i = 0; i < 24; ++i)
        squares += std::pow(std::sin(kPi * static_cast<double>(i) / 24), 4);
      for (std::size_t k = 0; k < result->lines(); ++k) {
        std::complex<double> sum = 0;
        for (std::size_t i = 0; i < 24; ++i) {
          const double t = static_cast<double>(i);
          sum +=
              (x[7 * f + i] - offset - slope * t) * std::pow(std::sin(kPi * t / 24), 2) *
              std::polar(1.0, -kTwoPi * static_cast<double>(k) * t / static_cast<double>(points));
        }
        const double sides = k == 0 || 2 * k == points ? 1 : 2;
        worst = std::max(worst, std::abs(result->at(f, k) - sides * std::norm(sum) / squares /
                                                                static_cast<double>(points)));
      }
      CHECK_NEAR(result->t_s[f], (7.0 * static_cast<double>(f) + 11.5) / 100, 1e-12);
    }
    CHECK_NEAR(worst, 0, 1e-12);  // rounding of sums of 24 numbers of size 3
  }
}

void a_sinusoid_keeps_its_mean_square() {
  std::vector<double> x;
  for (int i = 0; i < 4000; ++i) x.push_back(3 * std::sin(kTwoPi * 1234.5 * i / 8000 + 0.3));
  for (const auto shape :
       {WindowShape::rectangular, WindowShape::hann, WindowShape::hamming, WindowShape::blackman}) {
    const auto result = short_time_fourier(x, 8000, {400, 100, 6400, shape, Detrend::none});
    CHECK(result.has_value());
    for (std::size_t f = 0; f < result->frames(); ++f) {
      double sum = 0, highest = 0;
      std::size_t at = 0;
      for (std::size_t k = 0; k < result->lines(); ++k) {
        sum += result->at(f, k);
        if (result->at(f, k) > highest) highest = result->at(f, at = k);
      }
      // With the sharpest window the sinusoid's own mirror image adds 1/(N sin w) of the power to
      // the sum, twice that to the line; off by half a line spacing, 1/32 of a lobe, that line
      // loses (pi/32)^2 / 3.
      const double image = 1 / (400 * std::sin(kTwoPi * 1234.5 / 8000));
      CHECK_NEAR(sum, 4.5, 4.5 * image);
      CHECK_NEAR(highest * result->peak_to_mean_square, 4.5,
                 4.5 * (2 * image + image * image + kPi * kPi / 1024 / 3));
      CHECK_NEAR(result->frequency_hz[at], 1234.5, 8000.0 / 6400);
    }
  }
}

// A linear chirp is found at the frequency of the middle of each window.
void follows_a_chirp() {
  std::vector<double> x;
  for (int i = 0; i < 8000; ++i) {
    const double t = i / 8000.0;
    x.push_back(std::sin(kTwoPi * (1000 * t + 0.5 * 800 * t * t)));
  }
  const auto result = short_time_fourier(x, 8000, {256, 64, 8192, WindowShape::hann, {}});
  CHECK(result.has_value());
  for (std::size_t f = 0; f < result->frames(); ++f) {
    std::size_t at = 0;
    for (std::size_t k = 0; k < result->lines(); ++k)
      if (result->at(f, k) > result->at(f, at)) at = k;
    CHECK_NEAR(result->frequency_hz[at], 1000 + 800 * result->t_s[f], 1.5);
  }
}

void a_bad_sample_spoils_its_frames_only() {
  std::vector<double> x(100, 1.0);
  x[50] = std::numeric_limits<double>::infinity();
  const auto result = short_time_fourier(x, 1, {10, 10, 0, WindowShape::hann, Detrend::none});
  CHECK(result.has_value());
  for (std::size_t f = 0; f < 10; ++f) CHECK(std::isfinite(result->at(f, 2)) == (f != 5));
}

void refuses() {
  const std::vector<double> x(100, 1.0);
  CHECK(!short_time_fourier(x, 0, {}));
  CHECK(!short_time_fourier(x, 1, {128, 1, 0, WindowShape::hann, Detrend::none}));
  CHECK(!short_time_fourier(x, 1, {16, 0, 0, WindowShape::hann, Detrend::none}));
  CHECK(!short_time_fourier(x, 1, {16, 1, 8, WindowShape::hann, Detrend::none}));
  CHECK(!short_time_fourier(x, 1, {3, 1, 0, WindowShape::hann, Detrend::none}));
}

}  // namespace

int main() {
  equals_the_direct_sum();
  a_sinusoid_keeps_its_mean_square();
  follows_a_chirp();
  a_bad_sample_spoils_its_frames_only();
  refuses();
  return check::done();
}
