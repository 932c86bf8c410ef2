// Sine, cosine and exponential against <cmath> in long double, over their whole stated range.
#include <algorithm>
#include <limits>

#include "check.hpp"
#include "servosense/core/fast_math.hpp"
#include "servosense/core/units.hpp"

namespace {

using servosense::exp_negative;
using servosense::sine_cosine;

template <typename Real>
void sine_and_cosine(double bound) {
  double worst = 0;
  double worst_norm = 0;
  constexpr int kSteps = 2'000'003;  // odd, so that no grid point repeats from quarter to quarter
  for (int i = 0; i <= kSteps; ++i) {
    const auto angle = static_cast<Real>(-servosense::kTwoPi + 3 * servosense::kTwoPi * i / kSteps);
    const auto [s, c] = sine_cosine(angle);
    const auto a = static_cast<long double>(angle);
    worst =
        std::max({worst, static_cast<double>(std::abs(static_cast<long double>(s) - std::sin(a))),
                  static_cast<double>(std::abs(static_cast<long double>(c) - std::cos(a)))});
    const double norm = static_cast<double>(s) * static_cast<double>(s) +
                        static_cast<double>(c) * static_cast<double>(c);
    worst_norm = std::max(worst_norm, std::abs(norm - 1));
  }
  check::figure("sine_cosine: largest error", worst);
  CHECK_BETWEEN(worst, 0.0, bound);
  CHECK_BETWEEN(worst_norm, 0.0, 2 * bound);
}

template <typename Real>
void exponential() {
  double worst = 0;
  for (int i = 0; i < 2'000'000; ++i) {
    const auto x = static_cast<Real>(80.0 * i / 2'000'000);
    const long double exact = std::exp(-static_cast<long double>(x));
    worst = std::max(
        worst,
        static_cast<double>(std::abs(static_cast<long double>(exp_negative(x)) - exact) / exact));
  }
  check::figure("exp_negative: largest relative error", worst);
  CHECK_BETWEEN(worst, 0.0, 3e-7);
  CHECK(exp_negative(Real(0)) == Real(1));
  CHECK(exp_negative(Real(80)) == Real(0));
  CHECK(exp_negative(std::numeric_limits<Real>::infinity()) == Real(0));
  CHECK(exp_negative(std::numeric_limits<Real>::quiet_NaN()) == Real(0));
}

// The points where a quarter is chosen, and both ends, hit exactly.
void corners() {
  for (int eighth = -8; eighth <= 16; ++eighth) {
    const double angle = eighth * servosense::kPi / 4;
    CHECK_NEAR(sine_cosine(angle).sine, std::sin(angle), 1e-15);
    CHECK_NEAR(sine_cosine(angle).cosine, std::cos(angle), 1e-15);
  }
  static_assert(sine_cosine(0.0F).sine == 0.0F && sine_cosine(0.0F).cosine == 1.0F);
}

// Against the two comparisons it stands for, where they could part: beside both ends, at numbers
// that are none, and anywhere.
template <typename Real>
void fraction() {
  using Limits = std::numeric_limits<Real>;
  const Real tiny = Limits::denorm_min();
  for (const Real x : {Real(0), tiny, Limits::min(), Real(0.5), Real(1) - Limits::epsilon() / 2,
                       Real(1), Real(1) + Limits::epsilon(), -tiny, Real(-1), Limits::max(),
                       Limits::infinity(), -Limits::infinity(), Limits::quiet_NaN()})
    CHECK(servosense::is_fraction(x) == (x >= 0 && x < 1));
  CHECK(!servosense::is_fraction(Real(-0.0)));
  for (int i = -3000; i <= 3000; ++i) {
    const Real x = static_cast<Real>(i) / 1024;
    CHECK(servosense::is_fraction(x) == (x >= 0 && x < 1));
  }
}

}  // namespace

int main() {
  fraction<float>();
  fraction<double>();
  sine_and_cosine<float>(1.2e-7);
  sine_and_cosine<double>(1e-15);
  exponential<float>();
  exponential<double>();
  corners();
  return check::done();
}
