// Biquad against the difference equation in long double and its transfer function.
#include <complex>
#include <limits>
#include <random>
#include <string>

#include "check.hpp"
#include "oracles/frequency_response.hpp"
#include "servosense/dsp/biquad.hpp"

namespace {

using namespace servosense;

// Poles r e^(+-j angle), zeros on the unit circle at `zero_angle`.
BiquadConfig section(double r, double angle, double zero_angle) {
  return {0.3, -0.6 * std::cos(zero_angle), 0.3, -2 * r * std::cos(angle), r * r};
}

template <typename Real>
void against_the_difference_equation(double relative) {
  const unsigned seed = 11;
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> value(-1, 1);
  for (const double r : {0.2, 0.9, 0.99}) {
    const BiquadConfig c = section(r, 0.5, 1.2);
    CHECK(Biquad<Real>::validate(c).ok());
    Biquad<Real> block;
    block.configure(c);
    // The block's own (rounded) coefficients, so that only its arithmetic is judged.
    auto rounded = [](double x) { return static_cast<long double>(static_cast<Real>(x)); };
    const long double b0 = rounded(c.b0), b1 = rounded(c.b1), b2 = rounded(c.b2),
                      a1 = rounded(c.a1), a2 = rounded(c.a2);
    long double x1 = 0, x2 = 0, y1 = 0, y2 = 0, worst = 0, largest = 0;
    for (int n = 0; n < 100'000; ++n) {
      const Real x = static_cast<Real>(value(random));
      const long double now = static_cast<long double>(x);
      const long double y = b0 * now + b1 * x1 + b2 * x2 - a1 * y1 - a2 * y2;  // direct form I
      x2 = x1, x1 = now, y2 = y1, y1 = y;
      worst = std::max(worst, std::abs(static_cast<long double>(block.process(x)) - y));
      largest = std::max(largest, std::abs(y));
    }
    // Rounding enters at each of three sums and leaves through the poles: sum |h| <= 1/(1-r)^2.
    const auto bound = static_cast<double>(largest) * relative / ((1 - r) * (1 - r));
    check::near(static_cast<double>(worst), 0, bound,
                ("difference equation, seed " + std::to_string(seed)).c_str(), __FILE__, __LINE__);
  }
}

void transfer_function() {
  const BiquadConfig c = section(0.9, 0.5, 1.2);
  Biquad<double> block;
  block.configure(c);
  const auto h = oracle::impulse_response([&](double x) { return block.process(x); }, 1000);
  for (const double angle : {0.0, 0.3, 0.5, 1.0, 2.0, 3.14159}) {
    const std::complex<double> w = std::polar(1.0, -angle);
    const auto expected = (c.b0 + c.b1 * w + c.b2 * w * w) / (1.0 + c.a1 * w + c.a2 * w * w);
    CHECK_NEAR(std::abs(oracle::response(h, angle) - expected), 0.0, 1e-12);
  }
  CHECK_NEAR(std::abs(oracle::response(h, 1.2)), 0.0, 1e-13);
}

// validate() against the roots of z^2 + a1 z + a2.
void stability() {
  int stable = 0;
  for (double a1 = -2.5; a1 <= 2.5; a1 += 0.0373)
    for (double a2 = -1.5; a2 <= 1.5; a2 += 0.0417) {
      const std::complex<double> root = std::sqrt(std::complex<double>(a1 * a1 - 4 * a2, 0));
      const double radius = std::max(std::abs(-a1 + root), std::abs(-a1 - root)) / 2;
      const bool ok = Biquad<double>::validate({1, 0, 0, a1, a2}).ok();
      CHECK(ok == (radius < 1));
      stable += ok;
    }
  CHECK(stable > 1000);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(!Biquad<double>::validate({nan, 0, 0, 0, 0}).ok());
  CHECK_TEXT(Biquad<double>::validate({1, 0, 0, nan, 0}).parameter(), "a1");
  CHECK_TEXT(Biquad<double>::validate({1, 0, 0, 0, nan}).parameter(), "a2");
  CHECK(!Biquad<double>::validate({1, 0, 0, -2, 1}).ok());  // two poles at z = 1
}

template <typename Real>
void start_and_faults() {
  const BiquadConfig c = section(0.9, 0.5, 1.2);
  Biquad<Real> block;
  block.configure(c);
  for (int n = 0; n < 2000; ++n) block.process(Real(7));
  const double settled = static_cast<double>(block.state().output);
  const double gain = (c.b0 + c.b1 + c.b2) / (1 + c.a1 + c.a2);
  const double tolerance = 1000 * static_cast<double>(std::numeric_limits<Real>::epsilon());
  CHECK_NEAR(settled, 7 * gain, tolerance);
  Biquad<Real> primed;
  primed.configure(c);
  primed.prime(Real(7));
  for (int n = 0; n < 50; ++n)
    CHECK_NEAR(static_cast<double>(primed.process(Real(7))), 7 * gain, tolerance);

  Biquad<Real> twin = block;
  for (const Real bad :
       {std::numeric_limits<Real>::quiet_NaN(), std::numeric_limits<Real>::infinity()}) {
    CHECK(block.process(bad) == twin.state().output);
    CHECK(block.state().held);
  }
  CHECK(block.process(Real(2)) == twin.process(Real(2)));
  CHECK(!block.state().held);
  block.reset();
  CHECK(block.process(Real(1)) == Real(c.b0));
}

}  // namespace

int main() {
  against_the_difference_equation<float>(6 * 6e-8);
  against_the_difference_equation<double>(6 * 1.2e-16);
  transfer_function();
  stability();
  start_and_faults<float>();
  start_and_faults<double>();
  return check::done();
}
