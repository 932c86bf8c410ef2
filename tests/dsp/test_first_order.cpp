// Low-pass and pseudo-derivative against their laws in s, mapped to z by hand.
#include <complex>
#include <limits>
#include <random>
#include <string>

#include "check.hpp"
#include "oracles/frequency_response.hpp"
#include "servosense/core/units.hpp"
#include "servosense/dsp/first_order.hpp"

namespace {

using namespace servosense;
constexpr double kPeriod_s = 125e-6;

template <typename Real>
constexpr double unit_roundoff() {
  return static_cast<double>(std::numeric_limits<Real>::epsilon()) / 2;
}

std::complex<double> s_of(Discretisation d, double angle) {
  const std::complex<double> z = std::polar(1.0, angle);
  return d == Discretisation::tustin ? 2 / kPeriod_s * (z - 1.0) / (z + 1.0)
                                     : (z - 1.0) / (kPeriod_s * z);
}

// H(z) is g/(s+g) or s g/(s+g) with s replaced by the rule's expression in z.
template <typename Real>
void laws() {
  for (const Discretisation d : {Discretisation::tustin, Discretisation::backward_euler})
    for (const double g : {335.0, 500.0, 3500.0, 12000.0}) {
      const FirstOrderConfig c{g, kPeriod_s, d};
      CHECK(LowPass<Real>::validate(c).ok());
      LowPass<Real> low;
      low.configure(c);
      PseudoDerivative<Real> rate;
      rate.configure(c);
      const auto h = oracle::impulse_response([&](double x) { return low.process(Real(x)); }, 2000);
      double last = 0;
      const auto k = oracle::impulse_response(
          [&](double x) {
            const double increment = x - last;
            last = x;
            return rate.process(Real(increment));
          },
          2000);
      for (const double angle : {0.0, 0.001, 0.03, 0.4, 1.0, 2.0, 3.1}) {
        const std::complex<double> s = s_of(d, angle);
        const std::complex<double> expected = g / (s + g);
        // Each sample carries a few roundings; the sum of |h| is 1, that of |k| 2 g.
        const double tolerance = 200 * unit_roundoff<Real>();
        CHECK_NEAR(std::abs(oracle::response(h, angle) - expected), 0.0, tolerance);
        CHECK_NEAR(std::abs(oracle::response(k, angle) - s * expected), 0.0, tolerance * 2 * g);
      }
    }
}

// Against the laws in s itself: the step response of the low-pass is 1 - e^(-g t), and a ramp is
// differentiated to its slope exactly.
template <typename Real>
void rest_and_ramp() {
  const double g = 500;
  LowPass<Real> low;
  low.configure({g, kPeriod_s});
  double worst = 0;
  for (int n = 0; n < 400; ++n) {
    // The trapezoid rule puts a step between two samples in their middle.
    const double t = (n + 0.5) * kPeriod_s;
    worst = std::max(worst,
                     std::abs(static_cast<double>(low.process(Real(1))) - (1 - std::exp(-g * t))));
  }
  // Worst at the first sample: x/(1+x) against 1 - e^-x with x = g T/2, x^2/2 apart.
  CHECK_BETWEEN(worst, 1e-6, (g * kPeriod_s) * (g * kPeriod_s) / 8);

  // A gain of exactly one at rest, in float too: the correction vanishes only when y = x.
  for (const double level : {1.0, 94.0, 1.0e6}) {
    low.reset();
    for (int n = 0; n < 4000; ++n) low.process(Real(level));
    CHECK_NEAR(static_cast<double>(low.state().output), level, level * 64 * unit_roundoff<Real>());
    low.prime(Real(level));
    for (int n = 0; n < 100; ++n) CHECK(low.process(Real(level)) == Real(level));
  }

  PseudoDerivative<Real> rate;
  rate.configure({g, kPeriod_s});
  for (int n = 0; n < 4000; ++n) rate.process(Real(1e-4));
  CHECK_NEAR(static_cast<double>(rate.state().output), 0.8, 0.8 * 64 * unit_roundoff<Real>());
  rate.prime(Real(1e-4));
  const Real primed = rate.state().output;
  for (int n = 0; n < 100; ++n)
    CHECK_NEAR(static_cast<double>(rate.process(Real(1e-4))), static_cast<double>(primed),
               0.8 * 4 * unit_roundoff<Real>());
}

// 24 h at 8 kHz are 7e8 samples; a contraction that is right after 1e6 random ones stays so. The
// float block is held against the same recursion in long double.
void no_drift() {
  const unsigned seed = 7;
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> value(-1000.0F, 1000.0F);
  const double g = 3500;
  LowPass<float> low;
  low.configure({g, kPeriod_s});
  const auto c = static_cast<long double>(g * kPeriod_s / (2 + g * kPeriod_s));
  long double y = 0;
  long double last = 0;
  double worst = 0;
  for (int n = 0; n < 1'000'000; ++n) {
    const float x = value(random);
    const long double now = static_cast<long double>(x);
    y = (1 - 2 * c) * y + c * (now + last);
    last = now;
    worst = std::max(worst,
                     static_cast<double>(std::abs(static_cast<long double>(low.process(x)) - y)));
  }
  // Four roundings a sample of at most 2000 u, times 1 / (1 - pole) = 1 / (2 c).
  const double bound = 4 * 2000 * unit_roundoff<float>() / static_cast<double>(2 * c);
  check::figure("low-pass in float, 1e6 samples: largest error / 1000", worst / 1000);
  check::near(worst, 0, bound, ("no drift, seed " + std::to_string(seed)).c_str(), __FILE__,
              __LINE__);
}

template <typename Real>
void faults() {
  LowPass<Real> low;
  low.configure({500, kPeriod_s});
  PseudoDerivative<Real> rate;
  rate.configure({500, kPeriod_s});
  LowPass<Real> never;
  never.configure({500, kPeriod_s});
  for (int n = 0; n < 20; ++n) {
    low.process(Real(3));
    never.process(Real(3));
    rate.process(Real(1));
  }
  const Real before = low.state().output;
  const Real rate_before = rate.state().output;
  for (const Real bad :
       {std::numeric_limits<Real>::quiet_NaN(), std::numeric_limits<Real>::infinity(),
        -std::numeric_limits<Real>::infinity()}) {
    CHECK(low.process(bad) == before);
    CHECK(low.state().held);
    CHECK(rate.process(bad) == rate_before);
    CHECK(rate.state().held);
  }
  CHECK(low.process(Real(3)) == never.process(Real(3)));  // as if it had never been
  CHECK(!low.state().held);
  CHECK(is_finite(rate.process(Real(1))) && !rate.state().held);
}

void refusals() {
  auto refused = [](FirstOrderConfig c, const char* parameter) {
    const Status s = LowPass<float>::validate(c);
    CHECK(!s.ok());
    CHECK_TEXT(s.parameter(), parameter);
    CHECK(!PseudoDerivative<double>::validate(c).ok());
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  refused({0, kPeriod_s}, "cutoff_rad_s");
  refused({nan, kPeriod_s}, "cutoff_rad_s");
  refused({500, 0}, "sample_period_s");
  refused({500, nan}, "sample_period_s");
  refused({16000, kPeriod_s}, "cutoff_rad_s");  // g T = 2: Tustin's pole at 0, then sign changes
  CHECK(LowPass<float>::validate({16000, kPeriod_s, Discretisation::backward_euler}).ok());
  CHECK(LowPass<float>::validate({15999, kPeriod_s}).ok());
}

}  // namespace

int main() {
  laws<float>();
  laws<double>();
  rest_and_ramp<float>();
  rest_and_ramp<double>();
  no_drift();
  faults<float>();
  faults<double>();
  refusals();
  return check::done();
}
