// The elastoplastic sign against its continuous law and against hand-worked paths.
#include <algorithm>
#include <limits>
#include <random>
#include <string>

#include "check.hpp"
#include "servosense/model/elastoplastic_sign.hpp"

namespace {

using servosense::ElastoplasticSign;

template <typename Real>
void paths() {
  ElastoplasticSign<Real> sign;
  CHECK(ElastoplasticSign<Real>::validate(4.0).ok());
  sign.configure(4.0);
  // Out, back, and half way: the sign swings over within two knees of travel.
  const double step[] = {1, 1, 2, 3, -1, -3, -4, -5, 2, 0, 0, 2};
  const double expected[] = {0.25, 0.5, 1, 1, 0.75, 0, -1, -1, -0.5, -0.5, -0.5, 0};
  for (std::size_t i = 0; i < std::size(step); ++i)
    CHECK(sign.process(static_cast<Real>(step[i])) == static_cast<Real>(expected[i]));
  sign.reset();
  CHECK(sign.process(Real(0)) == Real(0));
}

// Any path, cut into finer steps, ends at the same place as long as it does not turn within a step:
// the law depends on the path alone, not on the speed. Oracle: the path in 64 small steps.
void rate_independent() {
  const unsigned seed = 3;
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> step(-6e-6, 6e-6);
  ElastoplasticSign<double> sign;
  sign.configure(5e-6);
  double z = 0;
  double worst = 0;
  for (int n = 0; n < 50'000; ++n) {
    const double dx = step(random);
    for (int k = 0; k < 64; ++k) z = std::clamp(z + dx / 64, -5e-6, 5e-6);
    worst = std::max(worst, std::abs(sign.process(dx) - z / 5e-6));
  }
  // 64 roundings of the oracle a step; clamping forgets what went before.
  check::near(worst, 0, 1e-10, ("path, seed " + std::to_string(seed)).c_str(), __FILE__, __LINE__);
}

// Far beyond the knee it is sgn(v); inside, encoder noise of one count moves it by count / knee.
template <typename Real>
void no_chatter_at_rest() {
  const unsigned seed = 4;
  std::mt19937 random(seed);
  const double count = 16e-3 / (1 << 20);
  ElastoplasticSign<Real> sign;
  sign.configure(5e-6);
  for (int n = 0; n < 1000; ++n) sign.process(Real(1e-6));
  CHECK(sign.state().deflection == Real(1));
  double last_place = 0, low = 1, high = -1;
  for (int n = 0; n < 100'000; ++n) {
    const double place = static_cast<double>(random() % 2) * count;
    const double s = static_cast<double>(sign.process(static_cast<Real>(place - last_place)));
    last_place = place;
    low = std::min(low, s);
    high = std::max(high, s);
  }
  check::figure("sign at rest under one count of noise: spread", high - low);
  // One count over the knee; in float the sum of 1e5 increments errs besides (1e-7 a count).
  check::near(low, 1.0, count / 5e-6 * 1.001 + 1e-5,
              ("spread, seed " + std::to_string(seed)).c_str(), __FILE__, __LINE__);
  CHECK(high <= 1.0);
}

void refusals() {
  CHECK(!ElastoplasticSign<float>::validate(0).ok());
  CHECK(!ElastoplasticSign<float>::validate(-1e-6).ok());
  CHECK(!ElastoplasticSign<float>::validate(std::numeric_limits<double>::quiet_NaN()).ok());
}

}  // namespace

int main() {
  paths<float>();
  paths<double>();
  rate_independent();
  no_chatter_at_rest<float>();
  no_chatter_at_rest<double>();
  refusals();
  return check::done();
}
