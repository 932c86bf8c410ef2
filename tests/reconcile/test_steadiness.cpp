// One size along the record, by hand: sizes that are known, and noise.
#include <cmath>
#include <cstddef>
#include <random>

#include "check.hpp"
#include "reconcile/select/steadiness.hpp"

using servosense::reconcile::Steadiness;

namespace {

constexpr std::size_t kStretches = 20, kRows = 500;

/// Rows of an effect of size 1 that is `size(stretch)` in truth, with noise of this rms.
template <typename Size>
Steadiness of(Size size, double noise) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal(0, noise > 0 ? noise : 1);
  Steadiness s(kStretches);
  for (std::size_t stretch = 0; stretch < kStretches; ++stretch)
    for (std::size_t row = 0; row < kRows; ++row) {
      const double effect = std::sin(0.1 * static_cast<double>(row));
      s.add(stretch, effect, (size(stretch) - 1) * effect + (noise > 0 ? normal(random) : 0));
    }
  return s;
}

}  // namespace

int main() {
  const auto steady = [](std::size_t) { return 1.0; };
  const auto jumps = [](std::size_t k) { return k % 2 == 0 ? 0.0 : 2.0; };
  const auto grows = [](std::size_t k) { return 2 * static_cast<double>(k) / (kStretches - 1); };
  CHECK(of(steady, 0).unsteadiness() < 1e-12);
  CHECK_NEAR(of(jumps, 0).unsteadiness(), 1, 1e-9);
  // Uniform over [0, 2] at so many points: sqrt((n + 1) / (3 (n - 1))).
  CHECK_NEAR(of(grows, 0).unsteadiness(), std::sqrt((kStretches + 1) / (3.0 * (kStretches - 1))),
             1e-9);
  // What noise alone looks like: its rms over the root of the power of a stretch.
  constexpr double kNoise = 3;
  const double seen = kNoise / std::sqrt(0.5 * kRows);
  CHECK_NEAR(of(steady, kNoise).unsteadiness(), seen, 0.4 * seen);
  // What is left of a chi-squared of so many stretches less its mean, three deviations.
  CHECK(of(steady, kNoise).unsteadiness(kNoise * kNoise) <
        seen * std::sqrt(3 * std::sqrt(2.0 / kStretches)));
  CHECK_NEAR(of(jumps, kNoise).unsteadiness(kNoise * kNoise), 1, 0.1);
  // Rows that do not count, and an effect that is nowhere.
  Steadiness none(2);
  none.add(0, 0, 5);
  none.add(1, 1, 1, 0);
  CHECK(none.unsteadiness() == 0);
  return check::done();
}
