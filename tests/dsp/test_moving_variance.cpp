// Moving variance against the two-pass variance of the same window, Parseval, and a day of samples.
#include <algorithm>
#include <array>
#include <complex>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "check.hpp"
#include "oracles/batch_variance.hpp"
#include "oracles/direct_dft.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/moving_variance.hpp"

namespace {

using servosense::MovingVariance;
using servosense::MovingVarianceView;

template <typename Real>
std::vector<double> last(const std::vector<Real>& x, std::size_t end, std::size_t n) {
  std::vector<double> window;
  for (std::size_t i = end - n; i < end; ++i) window.push_back(static_cast<double>(x[i]));
  return window;
}

// Torque of a cut with jumps of the mean: 20 Nm, a tone of 1 Nm, noise of 0.2 Nm.
template <typename Real>
std::vector<Real> torque(std::size_t count, unsigned seed, double jump) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0.0, 0.2);
  std::vector<Real> x(count);
  for (std::size_t i = 0; i < count; ++i)
    x[i] = static_cast<Real>(20 + jump * static_cast<double>(i / 1700 % 2) +
                             std::sin(0.2 * static_cast<double>(i)) + noise(random));
  return x;
}

// The bound the header states, d taken over the last two windows and their means.
template <typename Real>
void equals_two_passes(std::size_t n, double jump) {
  const double u = static_cast<double>(std::numeric_limits<Real>::epsilon()) / 2;
  double worst = 0;
  for (unsigned seed = 1; seed <= 3; ++seed) {
    const auto x = torque<Real>(12000, seed, jump);
    MovingVariance<Real, 600> block;
    block.configure({n});
    for (std::size_t i = 0; i < x.size(); ++i) {
      const auto value = static_cast<double>(block.process(x[i]));
      if (i % 7 != 0) continue;
      const std::size_t have = std::min(n, i + 1);
      const auto b = oracle::batch(last(x, i + 1, have));
      const std::size_t two = std::min(3 * n, i + 1);
      const auto [low, high] =
          std::minmax_element(x.end() - static_cast<std::ptrdiff_t>(x.size() - i - 1 + two),
                              x.end() - static_cast<std::ptrdiff_t>(x.size() - i - 1));
      const double d = static_cast<double>(*high - *low);
      const double bound = 8 * std::sqrt(static_cast<double>(n)) * u * (b.variance + d * d);
      const double error = std::abs(value - b.variance);
      worst = std::max(worst, error / bound);
      if (error > bound)
        check::fail(__FILE__, __LINE__) << "seed " << seed << ", sample " << i << ": error "
                                        << error << " above " << bound << '\n';
      const double mean_error = std::abs(static_cast<double>(block.state().mean) - b.mean);
      CHECK(mean_error <= 8 * std::sqrt(static_cast<double>(n)) * u * (d + 40));
    }
    CHECK(block.state().settled);
  }
  CHECK_BETWEEN(worst, 0.0, 1.0);
  check::figure("worst error / stated bound, N = " + std::to_string(n), worst);
}

// x + 1000 is exact in float because x is a multiple of 1/64, so the answers may only differ by
// rounding.
void offset_does_not_matter() {
  std::mt19937 random(4);
  std::uniform_int_distribution<int> pick(-128, 128);
  MovingVariance<float, 256> plain;
  MovingVariance<float, 256> offset;
  plain.configure({256});
  offset.configure({256});
  double worst = 0;
  for (int i = 0; i < 20000; ++i) {
    const float x = static_cast<float>(pick(random)) / 64.0F;
    const auto a = static_cast<double>(plain.process(x));
    const auto b = static_cast<double>(offset.process(x + 1000.0F));
    if (i > 256) worst = std::max(worst, std::abs(a - b) / a);
  }
  check::figure("offset of 1000: largest relative change", worst);
  CHECK_BETWEEN(worst, 0.0, 1e-5);
}

void parseval() {
  constexpr std::size_t kN = 96;
  const auto x = torque<double>(5 * kN + 17, 5, 0);
  MovingVariance<double, kN> block;
  block.configure({kN});
  for (double v : x) block.process(v);
  const auto window = last(x, x.size(), kN);
  double sum = 0;
  for (std::size_t k = 1; k < kN; ++k) sum += std::norm(oracle::direct_bin(window, k));
  CHECK_NEAR(block.state().variance * kN * kN, sum, 1e-12 * sum);
}

void sinusoid_gives_half_its_square() {
  MovingVariance<double, 400> block;
  block.configure({400});  // ten periods of 40 samples
  for (int i = 0; i < 3000; ++i)
    block.process(5 + 1.5 * std::sin(servosense::kTwoPi * i / 40 + 0.3));
  CHECK_NEAR(block.state().variance, 1.5 * 1.5 / 2, 1e-13);
  CHECK_NEAR(block.state().mean, 5, 1e-13);
}

template <typename Real>
void never_negative() {
  MovingVariance<Real, 128> block;
  block.configure({100});
  std::mt19937 random(6);
  std::uniform_real_distribution<double> value(-1, 1);
  bool ok = true;
  for (int i = 0; i < 60000; ++i) {
    const double scale = std::pow(10.0, i / 6000 - 3);  // constants, jumps and whispers
    const double x = (i / 500) % 2 == 0 ? scale : scale + 1e-6 * scale * value(random);
    const Real v = block.process(static_cast<Real>(i % 1000 == 0 ? -x : x));
    ok = ok && v >= 0 && servosense::is_finite(v);
  }
  CHECK(ok);
  for (int i = 0; i < 300; ++i) block.process(Real(7.7));
  CHECK_BETWEEN(static_cast<double>(block.state().variance), 0.0, 1e-10);
}

// Doubling is exact in binary, so the answer must be four times the other to the last bit.
void doubled_torque_is_fourfold_power() {
  const auto x = torque<float>(6000, 7, 5);
  MovingVariance<float, 512> one;
  MovingVariance<float, 512> two;
  one.configure({512});
  two.configure({512});
  bool ok = true;
  for (float v : x) ok = ok && 4.0F * one.process(v) == two.process(2.0F * v);
  CHECK(ok);
}

template <typename Real>
void one_bad_sample(Real bad) {
  constexpr std::size_t kN = 64;
  const auto x = torque<Real>(1000, 8, 0);
  MovingVariance<Real, kN> block;
  block.configure({kN});
  for (std::size_t i = 0; i < x.size(); ++i) {
    const bool faulty = i == 0 || i == 300 || i == 301;
    const Real v = block.process(faulty ? bad : x[i]);
    CHECK(servosense::is_finite(v));
    CHECK(block.state().input_held == faulty);
    if (i == 300 + 1 + kN) {  // the last stand-in has just left
      const auto b = oracle::batch(last(x, i + 1, kN));
      CHECK_NEAR(static_cast<double>(v), b.variance, 1e-5 * b.variance);
    }
  }
  CHECK(block.state().held == 3);
}

void caller_memory() {
  const auto x = torque<float>(3000, 9, 3);
  std::array<float, 200> memory{};
  MovingVarianceView<float> view(memory);
  MovingVariance<float, 200> owner;
  CHECK(view.validate({200}).ok());
  CHECK(!view.validate({201}).ok());
  CHECK(!view.validate({1}).ok());
  CHECK_TEXT((MovingVariance<float, 200>::validate({201}).parameter()), "window_samples");
  view.configure({150});
  owner.configure({150});
  bool ok = true;
  for (float v : x) ok = ok && view.process(v) == owner.process(v);
  CHECK(ok);
  owner.reset();
  CHECK(owner.state().variance == 0 && !owner.state().settled);
  CHECK(owner.process(3.0F) == 0);
}

// Hours at 8 kHz in float (24 at night, otherwise 1), beside the form that never starts anew. The
// signal is a table whose length shares no factor with the window, so every window differs from the
// one before.
void hours_of_samples(int hours) {
  constexpr std::size_t kN = 512;
  constexpr std::size_t kTable = 65521;  // a prime
  constexpr std::uint64_t kHour = 8000ULL * 3600;
  const auto table = torque<float>(kTable, 10, 0);
  auto block = std::make_unique<MovingVariance<float, kN>>();
  block->configure({kN});
  std::vector<float> ring(kN, 0.0F);
  float sum = 0;
  float square = 0;
  double worst = 0;
  double naive_worst = 0;
  std::size_t at = 0;
  std::size_t slot = 0;
  for (int hour = 1; hour <= hours; ++hour) {
    for (std::uint64_t i = 0; i < kHour; ++i) {
      const float x = table[at];
      if (++at == kTable) at = 0;
      block->process(x);
      sum += x;
      sum -= ring[slot];
      square += x * x;
      square -= ring[slot] * ring[slot];
      ring[slot] = x;
      if (++slot == kN) slot = 0;
    }
    std::vector<double> window;
    for (std::size_t i = 0; i < kN; ++i)
      window.push_back(static_cast<double>(table[(at + kTable - kN + i) % kTable]));
    const double exact = oracle::batch(window).variance;
    const double mean = static_cast<double>(sum) / kN;
    const double naive = static_cast<double>(square) / kN - mean * mean;
    worst = std::max(worst, std::abs(static_cast<double>(block->state().variance) - exact) / exact);
    naive_worst = std::max(naive_worst, std::abs(naive - exact) / exact);
    if (hour == 1)
      check::figure("1 h, float: relative error, sums that never start anew", naive_worst);
  }
  check::figure("float: relative error, sums that never start anew", naive_worst);
  check::figure("float: relative error, this block", worst);
  CHECK_BETWEEN(worst, 0.0, 1e-5);
  CHECK(naive_worst > 1e-3);  // else the signal was no test
}

}  // namespace

int main(int argc, char** argv) {
  const bool nightly = check::nightly(argc, argv);
  equals_two_passes<float>(512, 0);
  equals_two_passes<float>(100, 30);
  equals_two_passes<float>(2, 0);
  equals_two_passes<double>(512, 30);
  offset_does_not_matter();
  parseval();
  sinusoid_gives_half_its_square();
  never_negative<float>();
  never_negative<double>();
  doubled_torque_is_fourfold_power();
  for (float bad :
       {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity(), 1e30F}) {
    one_bad_sample<float>(bad);
    one_bad_sample<double>(static_cast<double>(bad));
  }
  caller_memory();
  hours_of_samples(nightly ? 24 : 1);
  return check::done();
}
