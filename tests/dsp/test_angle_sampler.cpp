// Sampling by angle: means against integrals, edges, both directions, trembling, faults.
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>
#include <vector>

#include "check.hpp"
#include "servosense/dsp/angle_sampler.hpp"
#include "servosense/sim/gaussian_noise.hpp"

using namespace servosense;

namespace {

double wrapped(double angle) { return angle - std::floor(angle / kTwoPi) * kTwoPi; }

/// Mean of cos(h angle + phase) from a to b.
double mean_of_line(double h, double phase, double a, double b) {
  return (std::sin(h * b + phase) - std::sin(h * a + phase)) / (h * (b - a));
}

// A cosine of the angle has a known mean over each part; the straight lines between samples cost
// (h step)^2 / 8 of it at most, at any ratio of samples to parts.
template <typename Real>
void closed_form() {
  double worst = 0;
  for (const unsigned n : {1U, 2U, 3U, 8U, 12U, 28U})
    for (const double step : {0.0101, 0.0313, 0.1}) {
      AngleSampler<Real, 2> sampler;
      sampler.configure({n, 0.7});
      double angle = 0.3;
      int parts = 0;
      for (int k = 0; k < 3000; ++k, angle += step) {
        const auto x = static_cast<Real>(5 + std::cos(2 * angle + 0.4));
        const auto y = static_cast<Real>(-3 * angle);
        if (!sampler.process({x, y}, static_cast<Real>(wrapped(angle)), Quality::good)) continue;
        ++parts;
        const auto& p = sampler.state().part;
        // The edge just passed, by index and by angle.
        const double to = 0.7 + std::floor((angle - 0.7) / kTwoPi * n) * kTwoPi / n;
        const double from = to - kTwoPi / n;
        const double expected = 5 + mean_of_line(2, 0.4, from, to);
        const double bound = 4 * step * step / 8 + (sizeof(Real) == 4 ? 2e-5 : 1e-12);
        worst = std::max(worst, std::abs(static_cast<double>(p.mean[0]) - expected) / bound);
        // A ramp in the angle: its mean is its middle, to rounding of the position.
        CHECK_NEAR(static_cast<double>(p.mean[1]), -3 * (from + to) / 2,
                   sizeof(Real) == 4 ? 1e-3 : 1e-9);
        CHECK(static_cast<int>(p.in_a_row) == parts && p.direction == 1);
      }
      CHECK_BETWEEN(parts, 3000 * step / kTwoPi * n - 2, 3000 * step / kTwoPi * n);
    }
  check::figure("mean of a line: largest multiple of its bound", worst);
  CHECK_BETWEEN(worst, 0.05, 1.0);
}

// Whatever the speed does, the means of a turn have the mean of the turn, and a constant is itself.
void speed_may_change() {
  AngleSampler<float> twelve, one;
  twelve.configure({12, 0});
  one.configure({1, 0});
  AngleSampler<float> constant;
  constant.configure({12, 0});
  double angle = 0.01, sum = 0, worst = 0;
  bool exact = true;
  int turns = 0, parts = 0;
  for (int k = 0; k < 40000; ++k) {
    angle += 0.05 * (1.2 + std::sin(k * 1e-3)) + 1e-4;
    const auto a = static_cast<float>(wrapped(angle));
    const auto x = static_cast<float>(20 + 4 * std::cos(angle) + std::cos(6 * angle + 1));
    if (constant.process(0.1F, a, Quality::good))
      exact = exact && constant.state().part.mean[0] == 0.1F;
    if (twelve.process(x, a, Quality::good)) {
      sum += static_cast<double>(twelve.state().part.mean[0]);
      ++parts;
      // Independent of speed: sixth harmonic and first over this part, less the straight lines.
      const double from = twelve.state().part.index * kTwoPi / 12;
      const double expected = 20 + 4 * mean_of_line(1, 0, from, from + kTwoPi / 12) +
                              mean_of_line(6, 1, from, from + kTwoPi / 12);
      CHECK_NEAR(static_cast<double>(twelve.state().part.mean[0]), expected, 36 * 0.11 * 0.11 / 12);
    }
    if (one.process(x, a, Quality::good)) {
      ++turns;
      if (turns > 1)
        worst = std::max(worst, std::abs(sum / 12 - static_cast<double>(one.state().part.mean[0])));
      if (turns > 1) CHECK(parts == 12);
      sum = 0;
      parts = 0;
    }
  }
  CHECK(exact);
  CHECK(turns > 300);
  check::figure("mean of twelve parts against the mean of the turn", worst);
  CHECK_BETWEEN(worst, 0.0, 1e-5);  // rounding of 20 in float, several times
}

void backwards_and_trembling() {
  AngleSampler<double> sampler;
  sampler.configure({8, 0});
  double angle = 100;
  std::uint32_t last = 99;
  int parts = 0;
  for (int k = 0; k < 2000; ++k, angle -= 0.03) {
    if (!sampler.process(std::cos(angle), wrapped(angle), Quality::good)) continue;
    const auto& p = sampler.state().part;
    CHECK(p.direction == -1 && p.in_a_row == static_cast<std::uint32_t>(++parts));
    if (last != 99) CHECK(p.index == (last + 7) % 8);
    last = p.index;
    const double from = p.index * kTwoPi / 8;
    CHECK_NEAR(p.mean[0], mean_of_line(1, 0, from, from + kTwoPi / 8), 0.03 * 0.03 / 12);
  }
  CHECK(parts > 70);

  // An encoder that trembles by more than it moves: same parts, same means but for the lines.
  GaussianNoise noise(2);
  sampler.configure({8, 0});
  angle = 0.2;
  parts = 0;
  for (int k = 0; k < 60000; ++k, angle += 0.002) {
    const double seen = angle + 0.004 * (noise.uniform() - 0.5);
    if (!sampler.process(std::cos(seen), wrapped(seen), Quality::good)) continue;
    const auto& p = sampler.state().part;
    ++parts;
    CHECK(p.direction == 1 && p.in_a_row == static_cast<std::uint32_t>(parts));
    const double from = p.index * kTwoPi / 8;
    CHECK_NEAR(p.mean[0], mean_of_line(1, 0, from, from + kTwoPi / 8), 1e-5);
  }
  CHECK_BETWEEN(parts, 60000 * 0.002 / kTwoPi * 8 - 2, 60000 * 0.002 / kTwoPi * 8 + 1);
  CHECK(sampler.state().restarts == 0);

  // Held in position over an edge: no part is ever complete.
  sampler.configure({8, 0});
  for (int k = 0; k < 10000; ++k)
    CHECK(!sampler.process(1.0, wrapped(0.001 * (k % 2 == 0 ? 1 : -1)), Quality::good));
  // A reversal breaks the row.
  sampler.configure({8, 0});
  for (int k = 0; k < 400; ++k) sampler.process(1.0, wrapped(0.1 * k), Quality::good);
  CHECK(sampler.state().part.in_a_row > 30);
  int k = 399;
  while (!(sampler.process(1.0, wrapped(0.1 * --k), Quality::good))) CHECK(k > 300);
  CHECK(sampler.state().part.direction == -1 && sampler.state().part.in_a_row == 1);
}

void faults() {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  auto run = [&](auto&& spoil) {
    AngleSampler<float> sampler;
    sampler.configure({12, 0});
    double worst = 0;
    for (int k = 0; k < 2000; ++k) {
      const double angle = 0.02 * k;
      float x = static_cast<float>(3 * std::cos(angle));
      float a = static_cast<float>(wrapped(angle));
      Quality q = Quality::good;
      spoil(k, x, a, q);
      if (!sampler.process(x, a, q)) continue;
      const auto& p = sampler.state().part;
      const double from = p.index * kTwoPi / 12;
      worst = std::max(worst, std::abs(static_cast<double>(p.mean[0]) -
                                       3 * mean_of_line(1, 0, from, from + kTwoPi / 12)));
    }
    CHECK_BETWEEN(worst, 1e-6, 3 * 0.25 * 0.25 / 8);  // a line over ten samples of 0.02 rad
    return sampler.state();
  };
  auto s = run([](int, float&, float&, Quality&) {});
  CHECK(s.restarts == 0 && s.part.left_out == 0 && s.part.in_a_row == 75);
  s = run([&](int k, float& x, float&, Quality&) { x = k % 50 == 7 ? nan : x; });
  CHECK(s.restarts == 0 && s.part.in_a_row == 75);
  s = run([&](int k, float&, float& a, Quality&) { a = k % 50 == 7 ? nan : a; });
  CHECK(s.restarts == 0 && s.part.in_a_row == 75);
  s = run([&](int k, float& x, float&, Quality& q) {
    if (k % 100 < 8) x = 1e6F, q = Quality::missing;
  });
  CHECK(s.restarts == 0 && s.part.in_a_row == 75);
  // Longer than a part: anew, and never a mean across the hole.
  s = run([&](int k, float& x, float&, Quality& q) {
    if (k >= 1000 && k < 1060) x = 1e6F, q = Quality::dead_bus;
  });
  CHECK(s.restarts == 1 && s.part.in_a_row < 40);
  for (const Quality flag : {Quality::gap, Quality::settling}) {
    s = run([&](int k, float& x, float&, Quality& q) {
      if (k >= 1000 && k < 1010) x = 1e6F, q = flag;
    });
    CHECK(s.restarts == 1 && s.part.in_a_row < 40);
  }
  s = run([&](int k, float&, float&, Quality& q) {
    if (k == 1000) q = Quality::restarted;
  });
  CHECK(s.restarts == 1 && s.part.in_a_row < 40);
  // Jump of the angle, unflagged.
  AngleSampler<float> sampler;
  sampler.configure({12, 0});
  for (int k = 0; k < 400; ++k)
    sampler.process(1, static_cast<float>(wrapped(0.02 * k + (k > 200 ? 2 : 0))), Quality::good);
  CHECK(sampler.state().restarts == 1);
  // Faster than a part a sample: nothing, aloud.
  sampler.configure({100, 0});
  for (int k = 0; k < 400; ++k)
    CHECK(!sampler.process(1, static_cast<float>(wrapped(0.1 * k)), Quality::good));
  CHECK(sampler.state().restarts > 300);
  // left_out counts what was missing in the part.
  sampler.configure({1, 0});
  int seen = 0;
  for (int k = 0; k < 1500; ++k) {
    const bool bad = k % 100 < 3;
    if (sampler.process(bad ? nan : 1.0F, static_cast<float>(wrapped(0.01 * k)), Quality::good)) {
      ++seen;
      CHECK_BETWEEN(sampler.state().part.left_out, 18, 21);
      CHECK_BETWEEN(sampler.state().part.samples + sampler.state().part.left_out, 628, 630);
    }
  }
  CHECK(seen == 1);
}

// A day at 8 kHz is four minutes of computing; an hour of a periodic signal already shows whether
// anything adds up: the last turn's parts are those of the second.
void an_hour() {
  AngleSampler<float> sampler;
  sampler.configure({12, 0});
  std::vector<float> angle(60), x(60);
  for (std::size_t i = 0; i < 60; ++i) {
    angle[i] = static_cast<float>(kTwoPi * (static_cast<double>(i) + 0.3) / 60);
    x[i] = static_cast<float>(50 + std::cos(kTwoPi * static_cast<double>(i) / 20));
  }
  float early[12], late[12];
  for (long turn = 0; turn < 8000L * 3600 / 60; ++turn)
    for (std::size_t i = 0; i < 60; ++i)
      if (sampler.process(x[i], angle[i], Quality::good)) {
        const auto& p = sampler.state().part;
        if (turn == 2) early[p.index] = p.mean[0];
        late[p.index] = p.mean[0];
      }
  CHECK(std::memcmp(early, late, sizeof early) == 0);
}

void refuses() {
  CHECK_TEXT((AngleSampler<float>::validate({0, 0}).parameter()), "samples_per_turn");
  CHECK_TEXT((AngleSampler<float>::validate({1001, 0}).parameter()), "samples_per_turn");
  CHECK_TEXT((AngleSampler<float>::validate({12, -1}).parameter()), "origin_rad");
  CHECK_TEXT((AngleSampler<float>::validate({12, std::nan("")}).parameter()), "origin_rad");
  CHECK_TEXT((AngleSampler<float>::validate({12, 6}).parameter()), "");
  static_assert(std::is_trivially_copyable_v<AngleSampler<float, 2>::State>);
}

}  // namespace

int main() {
  closed_form<double>();
  closed_form<float>();
  speed_may_change();
  backwards_and_trembling();
  faults();
  an_hour();
  refuses();
  return check::done();
}
