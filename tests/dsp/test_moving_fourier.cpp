// Moving Fourier lines against the direct sum over the same window, and a day of samples.
#include <algorithm>
#include <array>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "check.hpp"
#include "oracles/direct_dft.hpp"
#include "servosense/dsp/moving_fourier.hpp"
#include "servosense/dsp/moving_variance.hpp"

namespace {

using servosense::best_revolution_window;
using servosense::kTwoPi;
using servosense::MovingFourier;

// Angle after i samples of `turns` turns each, within one turn, without loss for large i.
double angle_after(std::uint64_t i, double turns) {
  const long double t = static_cast<long double>(i) * static_cast<long double>(turns);
  return static_cast<double>((t - std::floor(t)) * 2 * std::acos(-1.0L));
}

/// Largest error of the lines 1..harmonics after `count` samples, relative to N max|x|.
template <typename Real, std::size_t Harmonics>
double error_after(std::uint64_t count, std::size_t n, double turns, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> noise(-1, 1);
  MovingFourier<Real, 1024, Harmonics> block;
  block.configure({n, Harmonics});
  std::vector<double> x(n);
  std::vector<double> angle(n);
  for (std::uint64_t i = 0; i < count; ++i) {
    const Real value = static_cast<Real>(3 + noise(random));
    const Real a = static_cast<Real>(angle_after(i, turns));
    x[i % n] = static_cast<double>(value);
    angle[i % n] = static_cast<double>(a);
    block.process(value, a);
  }
  double worst = 0;
  for (std::size_t h = 1; h <= Harmonics; ++h) {
    const auto exact = oracle::direct_line(x, angle, static_cast<double>(h));
    const std::complex<double> line(static_cast<double>(block.cosine_sum(h)),
                                    -static_cast<double>(block.sine_sum(h)));
    worst = std::max(worst, std::abs(line - exact));
  }
  return worst / (4.0 * static_cast<double>(n));
}

void equals_direct_sum() {
  // Whole bins (32 turns in 512), fractional bins, backwards, above half the sample rate.
  for (double turns : {32.0 / 512, 0.0160427, -0.0160427, 0.3}) {
    const double in_double = error_after<double, 10>(1'200'000, 512, turns, 1);
    const double in_float = error_after<float, 10>(1'200'000, 512, turns, 2);
    check::figure("1.2 M samples, double: error / (N max|x|)", in_double);
    check::figure("1.2 M samples, float:  error / (N max|x|)", in_float);
    CHECK_BETWEEN(in_double, 0.0, 1e-13);
    CHECK_BETWEEN(in_float, 0.0, 1e-6);
  }
  CHECK_BETWEEN((error_after<double, 7>(5000, 187, 0.016, 3)), 0.0, 1e-13);  // odd count
  CHECK_BETWEEN((error_after<double, 1>(100, 512, 0.016, 4)), 0.0, 1e-13);   // still filling
}

template <typename Real>
void sinusoid_on_a_line(double tolerance) {
  MovingFourier<Real, 640, 10> block;
  block.configure({640, 10});
  CHECK(block.power(1) == 0);
  for (int i = 0; i < 2000; ++i) {
    const double a = angle_after(static_cast<std::uint64_t>(i), 1.0 / 64);
    block.process(static_cast<Real>(1.5 * std::sin(3 * a + 0.4)), static_cast<Real>(a));
  }
  for (std::size_t h = 1; h <= 10; ++h)
    CHECK_NEAR(static_cast<double>(block.power(h)), h == 3 ? 1.5 * 1.5 / 2 : 0.0, tolerance);
}

// What a window that is not a whole number of turns does, beside the same signal in a good one.
void a_bad_window_leaks() {
  const double turns = 7700.0 / 60 / 8000;
  for (std::size_t n : {187UL, 218UL, 512UL}) {
    MovingFourier<double, 512, 10> lines;
    servosense::MovingVariance<double, 512> total;
    lines.configure({n, 10});
    total.configure({n});
    double worst = 0;
    for (std::uint64_t i = 0; i < 6000; ++i) {
      const double a = angle_after(i, turns);
      const double x = 20 + std::cos(6 * a);
      lines.process(x, a);
      total.process(x);
      double forced = 0;
      for (std::size_t h = 1; h <= 10; ++h) forced += lines.power(h);
      if (i > 600) worst = std::max(worst, std::abs(total.state().variance - forced) / 0.5);
    }
    check::figure("7700 rpm, 770 Hz and 20 Nm: leak / forced, N = " + std::to_string(n), worst);
    if (n == 187) CHECK_BETWEEN(worst, 1e-4, 1e-2);  // 3 turns and 0.013 samples
    if (n == 218) CHECK(worst > 1);                  // 3.5 turns: worthless
    if (n == 512) CHECK(worst > 0.05);               // 8.2 turns
  }
}

void best_window() {
  const auto w = best_revolution_window(servosense::rad_s_from_rpm(7700), 8000, 100, 600);
  CHECK(w.samples == 187 && w.revolutions == 3);
  CHECK_NEAR(w.error_samples, 187 - 3 * 8000 * 60 / 7700.0, 1e-9);
  const auto longer = best_revolution_window(servosense::rad_s_from_rpm(7700), 8000, 200, 600);
  CHECK(longer.samples == 374 && longer.revolutions == 6);
  // Against every pair of length and turns.
  std::mt19937 random(5);
  std::uniform_real_distribution<double> rpm(1000, 20000);
  for (int i = 0; i < 50; ++i) {
    const double speed = servosense::rad_s_from_rpm(rpm(random));
    const auto best = best_revolution_window(-speed, 8000, 150, 700);
    double smallest = 1;
    for (int n = 150; n <= 700; ++n)
      for (int r = 1; r < 400; ++r)
        smallest = std::min(smallest, std::abs(n / (r * kTwoPi * 8000 / speed) - 1));
    const double reached =
        std::abs(static_cast<double>(best.samples) /
                     (static_cast<double>(best.revolutions) * kTwoPi * 8000 / speed) -
                 1);
    CHECK_NEAR(reached, smallest, 2e-9);
  }
  CHECK(best_revolution_window(100, 8000, 10, 400).samples == 0);  // a turn is 503 samples
  CHECK(best_revolution_window(0, 8000, 10, 400).samples == 0);
  CHECK(best_revolution_window(std::nan(""), 8000, 10, 400).samples == 0);
}

void faults() {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  for (int input = 0; input < 2; ++input) {
    for (float bad : {nan, inf, -inf, 1e30F}) {
      MovingFourier<float, 64, 4> faulty;
      MovingFourier<float, 64, 4> clean;
      faulty.configure({64, 4});
      clean.configure({64, 4});
      for (int i = 0; i < 400; ++i) {
        const bool hit = i == 0 || i == 150;
        const float a = static_cast<float>(angle_after(static_cast<std::uint64_t>(i), 1.0 / 16));
        const float x = 1 + std::cos(2 * a);
        faulty.process(hit && input == 0 ? bad : x, hit && input == 1 ? bad : a);
        clean.process(x, a);
        CHECK(faulty.state().input_held == hit);
        for (std::size_t h = 1; h <= 4; ++h) CHECK(servosense::is_finite(faulty.power(h)));
        if (i >= 150 + 64)
          CHECK_NEAR(static_cast<double>(faulty.power(2)), static_cast<double>(clean.power(2)),
                     1e-6);
      }
      CHECK(faulty.state().held == 2);
      CHECK(faulty.state().settled);
    }
  }
  CHECK_TEXT((MovingFourier<float, 64, 4>::validate({65, 4}).parameter()), "window_samples");
  CHECK_TEXT((MovingFourier<float, 64, 4>::validate({64, 5}).parameter()), "harmonics");
  CHECK((MovingFourier<float, 64, 4>::validate({64, 4}).ok()));
}

// Hours at 8 kHz in float, beside one running sum of the same products that never starts anew: 24
// at night, otherwise 4, when that sum is as far off as tells one from the other.
void hours_of_samples(int hours) {
  constexpr std::size_t kN = 512;
  constexpr std::size_t kTable = 65521;  // a prime
  constexpr std::size_t kSteps = 499;    // angles, 31 turns in all
  constexpr std::uint64_t kHour = 8000ULL * 3600;
  std::mt19937 random(6);
  std::normal_distribution<double> noise(0, 0.2);
  std::vector<float> x(kTable);
  for (std::size_t i = 0; i < kTable; ++i)
    x[i] = static_cast<float>(20 + std::cos(2 * angle_after(i, 31.0 / kSteps)) + noise(random));
  std::array<float, kSteps> angle{};
  std::array<servosense::SineCosine<float>, kSteps> turn{};
  for (std::size_t i = 0; i < kSteps; ++i) {
    angle[i] = static_cast<float>(angle_after(i, 31.0 / kSteps));
    turn[i] = servosense::sine_cosine(angle[i]);
  }
  auto block = std::make_unique<MovingFourier<float, kN, 2>>();
  block->configure({kN, 2});
  std::vector<float> ring(kN, 0.0F);
  float naive = 0;  // cosine sum of the first line
  double worst = 0;
  double naive_worst = 0;
  std::size_t at = 0;
  std::size_t step = 0;
  std::size_t slot = 0;
  for (int hour = 1; hour <= hours; ++hour) {
    for (std::uint64_t i = 0; i < kHour; ++i) {
      block->process(x[at], angle[step]);
      const float product = x[at] * turn[step].cosine;
      naive += product;
      naive -= ring[slot];
      ring[slot] = product;
      if (++slot == kN) slot = 0;
      if (++at == kTable) at = 0;
      if (++step == kSteps) step = 0;
    }
    std::vector<double> window;
    std::vector<double> angles;
    for (std::size_t i = 0; i < kN; ++i) {
      window.push_back(static_cast<double>(x[(at + kTable - kN + i) % kTable]));
      angles.push_back(static_cast<double>(angle[(step + 2 * kSteps - kN + i) % kSteps]));
    }
    for (std::size_t h = 1; h <= 2; ++h) {
      const auto exact = oracle::direct_line(window, angles, static_cast<double>(h));
      const std::complex<double> line(static_cast<double>(block->cosine_sum(h)),
                                      -static_cast<double>(block->sine_sum(h)));
      worst = std::max(worst, std::abs(line - exact) / (kN / 2.0));
      if (h == 1)
        naive_worst =
            std::max(naive_worst, std::abs(static_cast<double>(naive) - exact.real()) / (kN / 2.0));
    }
    if (hour == 1)
      check::figure("1 h, float: error of a line, sums that never start anew", naive_worst, "Nm");
  }
  check::figure("float: error of a line, sums that never start anew", naive_worst, "Nm");
  check::figure("float: error of a line of 1 Nm, this block", worst, "Nm");
  CHECK_BETWEEN(worst, 0.0, 1e-4);
  CHECK(naive_worst > 2 * worst);
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  equals_direct_sum();
  sinusoid_on_a_line<double>(1e-14);
  sinusoid_on_a_line<float>(1e-6);
  a_bad_window_leaks();
  best_window();
  faults();
  hours_of_samples(nightly ? 24 : 4);
  return check::done();
}
