// Rotational filter against its definition (Koike 2016, eq. 2-71), the laws of sec. 2.3.4 and 6.2,
// and hours of samples.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "check.hpp"
#include "servosense/dsp/rotational_filter.hpp"

namespace {

using servosense::CosineWindow;
using servosense::kPi;
using servosense::kTwoPi;
using servosense::PlaneVector;
using servosense::Rotation;
using servosense::RotationalFilter;
using Wide = long double;

constexpr double kRate = 8000;
constexpr CosineWindow kWindows[] = {CosineWindow::rectangular, CosineWindow::hann,
                                     CosineWindow::blackman};

// Weights from their textbook form, not from the header.
Wide weight(CosineWindow window, std::size_t n, std::size_t count) {
  const Wide u = 2 * std::acos(-1.0L) * (Wide(n) + 0.5L) / Wide(count);
  switch (window) {
    case CosineWindow::rectangular:
      return 1;
    case CosineWindow::hann:
      return std::pow(std::sin(u / 2), 2);
    case CosineWindow::blackman:
      return 0.42L - 0.5L * std::cos(u) + 0.08L * std::cos(2 * u);
  }
  return 0;
}

struct Motion {
  std::vector<double> x, y, angle;
};

// The newest `count` samples up to `last`, written out.
PlaneVector<double> written_out(const Motion& m, std::size_t last, std::size_t count,
                                CosineWindow window, Rotation rotation) {
  Wide sx = 0;
  Wide sy = 0;
  Wide sum = 0;
  for (std::size_t n = 0; n < count; ++n) {
    const Wide w = weight(window, n, count);
    sum += w;
    if (n > last) continue;
    const Wide phi = Wide(m.angle[last]) - Wide(m.angle[last - n]);
    const auto x = Wide(m.x[last - n]);
    // Against the clock the same rotation the other way round.
    const Wide s = rotation == Rotation::clockwise ? std::sin(phi) : -std::sin(phi);
    sx += w * (x * std::cos(phi) + Wide(m.y[last - n]) * s);
    sy += w * (-x * s + Wide(m.y[last - n]) * std::cos(phi));
  }
  return {static_cast<double>(sx / sum), static_cast<double>(sy / sum)};
}

/// Largest error against the definition on noise at a changing speed, relative to max |x|, |y|.
template <typename Real>
double error_against_definition(std::size_t count, CosineWindow window, Rotation rotation,
                                unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> noise(-1, 1);
  auto block = std::make_unique<RotationalFilter<Real, 1024>>();
  block->configure({count, window, rotation});
  Motion m;
  double worst = 0;
  double angle = 0;
  for (std::size_t i = 0; i < 5 * count + 137; ++i) {
    // From a slow turn to a quarter turn a sample and back, forwards and backwards.
    angle += 0.8 * std::sin(0.003 * static_cast<double>(i)) + 0.1;
    angle -= kTwoPi * std::floor(angle / kTwoPi);
    m.x.push_back(static_cast<double>(static_cast<Real>(noise(random))));
    m.y.push_back(static_cast<double>(static_cast<Real>(noise(random))));
    m.angle.push_back(static_cast<double>(static_cast<Real>(angle)));
    const Real radius = block->process(static_cast<Real>(m.x.back()), static_cast<Real>(m.y.back()),
                                       static_cast<Real>(angle));
    CHECK(block->state().settled == (i + 1 >= count));
    if (i % 37 != 0 && i + 1 != count) continue;
    const auto exact = written_out(m, i, count, window, rotation);
    const auto& s = block->state();
    worst = std::max({worst, std::abs(static_cast<double>(s.output.x) - exact.x),
                      std::abs(static_cast<double>(s.output.y) - exact.y),
                      std::abs(static_cast<double>(radius) - std::hypot(exact.x, exact.y))});
  }
  return worst;
}

void equals_definition() {
  double in_float = 0;
  double in_double = 0;
  unsigned seed = 1;
  for (const CosineWindow window : kWindows)
    for (const Rotation rotation : {Rotation::clockwise, Rotation::counter_clockwise})
      for (std::size_t count : {8UL, 63UL, 500UL, 1024UL}) {
        in_float =
            std::max(in_float, error_against_definition<float>(count, window, rotation, seed));
        in_double =
            std::max(in_double, error_against_definition<double>(count, window, rotation, seed));
        ++seed;
      }
  check::figure("error / max|x|, recursive against definition, float", in_float);
  check::figure("error / max|x|, recursive against definition, double", in_double);
  CHECK_BETWEEN(in_float, 0.0, 2e-6);
  CHECK_BETWEEN(in_double, 0.0, 1e-14);

  // The direct form of the header, too.
  std::mt19937 random(40);
  std::uniform_real_distribution<double> any(-1, 1);
  Motion m;
  for (int i = 0; i < 500; ++i) {
    m.x.push_back(any(random));
    m.y.push_back(any(random));
    m.angle.push_back(3 * any(random));
  }
  for (const CosineWindow window : kWindows)
    for (const Rotation rotation : {Rotation::clockwise, Rotation::counter_clockwise}) {
      const auto direct =
          servosense::rotational_filter_direct<double>(m.x, m.y, m.angle, window, rotation);
      const auto exact = written_out(m, 499, 500, window, rotation);
      CHECK_NEAR(direct.x, exact.x, 1e-14);
      CHECK_NEAR(direct.y, exact.y, 1e-14);
    }
}

void length_is_exact() {
  std::mt19937 random(41);
  std::uniform_real_distribution<double> exponent(-17, 14);
  std::uniform_real_distribution<double> turn(0, kTwoPi);
  double in_float = 0;
  double in_double = 0;
  for (int i = 0; i < 100000; ++i) {
    const double r = std::pow(10.0, exponent(random));
    const double a = turn(random);
    const PlaneVector<double> d{r * std::cos(a), r * std::sin(a)};
    const PlaneVector<float> f{static_cast<float>(d.x), static_cast<float>(d.y)};
    in_double = std::max(in_double, std::abs(servosense::length_of(d) / std::hypot(d.x, d.y) - 1));
    const double exact = std::hypot(static_cast<double>(f.x), static_cast<double>(f.y));
    in_float =
        std::max(in_float, std::abs(static_cast<double>(servosense::length_of(f)) / exact - 1));
  }
  CHECK_BETWEEN(in_float, 0.0, 3e-7);
  CHECK_BETWEEN(in_double, 0.0, 1e-15);
  CHECK(servosense::length_of(PlaneVector<float>{0, 0}) == 0);
  CHECK(servosense::length_of(PlaneVector<double>{0, 0}) == 0);
}

struct Orbit {
  double radius, least_radius, largest_radius;  // over the last 0.1 s
};

/// Feeds x, y as functions of time to a filter on the frequency f0, and looks at the output's
/// orbit.
template <typename Signal>
Orbit filtered(double f0, std::size_t count, CosineWindow window, Rotation rotation,
               const Signal& signal) {
  RotationalFilter<double, 1000> block;
  block.configure({count, window, rotation});
  Orbit o{0, 1e300, 0};
  const std::size_t samples = count + 2400;
  double sum = 0;
  for (std::size_t i = 0; i < samples; ++i) {
    const double t = static_cast<double>(i) / kRate;
    const double turns = f0 * t;
    const auto [x, y] = signal(t);
    block.process(x, y, kTwoPi * (turns - std::floor(turns)));
    if (i < samples - 800) continue;
    const auto& s = block.state();
    const double r = std::hypot(s.output.x, s.output.y);
    CHECK_NEAR(s.radius, r, 1e-12 * (1 + r));
    sum += r / 800;
    o.least_radius = std::min(o.least_radius, r);
    o.largest_radius = std::max(o.largest_radius, r);
  }
  o.radius = sum;
  return o;
}

using Pair = std::pair<double, double>;

void radius_law() {
  const double w = kTwoPi * 150;
  // Koike 2016, eq. 2-68. Hann leaves 9e-5 of the counter-rotating part, 18.75 bins away.
  for (int k = -18; k <= 18; ++k) {
    const double d = kPi * k / 18;
    const Orbit o = filtered(150, 500, CosineWindow::hann, Rotation::clockwise, [&](double t) {
      return Pair{1000 * std::sin(w * t + 0.4), 1000 * std::sin(w * t + 0.4 + d)};
    });
    CHECK_NEAR(o.radius, 1000 * std::sqrt((1 + std::sin(d)) / 2), 0.1);
  }
  // Eq. 6-1: the phase counts the other way.
  auto of_alpha = [&](double alpha, CosineWindow window) {
    return filtered(150, 500, window, Rotation::clockwise,
                    [&](double t) {
                      return Pair{1000 * std::sin(w * t), 1000 * std::sin(w * t - alpha)};
                    })
        .radius;
  };
  CHECK_NEAR(of_alpha(-kPi / 2, CosineWindow::hann), 1000, 0.1);
  CHECK_NEAR(of_alpha(0, CosineWindow::hann), 707.1, 0.1);
  CHECK_NEAR(of_alpha(kPi / 2, CosineWindow::hann), 0, 0.1);
  CHECK_BETWEEN(of_alpha(kPi / 2, CosineWindow::rectangular), 1.0, 15.0);

  // Ellipses (eq. 6-2 to 6-6): any two amplitudes and phases; the output is a circle.
  std::mt19937 random(2);
  std::uniform_real_distribution<double> any(0, 1);
  for (int i = 0; i < 30; ++i) {
    const double a = 1000 * any(random);
    const double b = 1000 * any(random);
    const double d = kTwoPi * any(random);
    for (const Rotation rotation : {Rotation::clockwise, Rotation::counter_clockwise}) {
      const Orbit o = filtered(150, 500, CosineWindow::hann, rotation, [&](double t) {
        return Pair{a * std::sin(w * t), b * std::sin(w * t + d)};
      });
      const double sign = rotation == Rotation::clockwise ? 1 : -1;
      const double exact = 0.5 * std::sqrt(a * a + b * b + sign * 2 * a * b * std::sin(d));
      CHECK_NEAR(o.radius, exact, 0.1);
      CHECK_NEAR(o.largest_radius - o.least_radius, 0, 0.2);
    }
  }
}

void frequency_response() {
  // Derived for order 500 at 8 kHz, detuned both ways; rounded to three digits.
  const double detuning_hz[] = {5, 10, 16, 20, 30, 40, 50};
  const double rectangular[] = {.847, .471, 0, .180, .065, .127, .039};
  const double hann[] = {.939, .772, .500, .320, .026, .024, .004};
  for (int i = 0; i < 7; ++i)
    for (const double sign : {1.0, -1.0}) {
      const double w = kTwoPi * (150 + sign * detuning_hz[i]);
      auto circle = [&](double t) { return Pair{std::sin(w * t), std::cos(w * t)}; };
      CHECK_NEAR(filtered(150, 500, CosineWindow::rectangular, Rotation::clockwise, circle).radius,
                 rectangular[i], 6e-4);
      CHECK_NEAR(filtered(150, 500, CosineWindow::hann, Rotation::clockwise, circle).radius,
                 hann[i], 6e-4);
      // Blackman, from its definition as three lines of the periodic sinc.
      const double bins = detuning_hz[i] * 500 / kRate;
      auto line = [](double b) {
        return std::abs(b) < 1e-9 ? 1.0 : std::sin(kPi * b) / (500 * std::sin(kPi * b / 500));
      };
      // In the middle of the window the neighbours come in with the sign of e^(j pi) = -1.
      const double exact = std::abs(0.42 * line(bins) + 0.25 * (line(bins - 1) + line(bins + 1)) +
                                    0.04 * (line(bins - 2) + line(bins + 2))) /
                           0.42;
      CHECK_NEAR(filtered(150, 500, CosineWindow::blackman, Rotation::clockwise, circle).radius,
                 exact, 1e-4);
    }

  // Koike 2016, fig. 6-2: a circle at 150 Hz with ellipses at 110 and 180 Hz, equally large.
  const double w = kTwoPi;
  auto mix = [&](double t) {
    return Pair{std::sin(w * 150 * t) + std::sin(w * 110 * t) + std::sin(w * 180 * t),
                std::cos(w * 150 * t) + 0.9 * std::cos(w * 110 * t) + 0.9 * std::cos(w * 180 * t)};
  };
  const Orbit with = filtered(150, 500, CosineWindow::hann, Rotation::clockwise, mix);
  const Orbit without = filtered(150, 500, CosineWindow::rectangular, Rotation::clockwise, mix);
  check::figure("110/150/180 Hz: largest deviation from the circle, Hann",
                std::max(with.largest_radius - 1, 1 - with.least_radius));
  check::figure("110/150/180 Hz: largest deviation from the circle, rectangular",
                std::max(without.largest_radius - 1, 1 - without.least_radius));
  // 0.95 (0.024 + 0.026) from the table above; rectangular 0.95 (0.127 + 0.065).
  CHECK_BETWEEN(with.least_radius, 1 - 0.05, 1);
  CHECK_BETWEEN(with.largest_radius, 1, 1 + 0.05);
  CHECK_BETWEEN(without.largest_radius, 1.1, 1.2);
}

// Against the clock is with the clock, y turned over before and after: to the last bit.
void rotations_mirror() {
  std::mt19937 random(3);
  std::normal_distribution<float> noise(0, 10);
  RotationalFilter<float, 500> with;
  RotationalFilter<float, 500> against;
  with.configure({500, CosineWindow::hann, Rotation::clockwise});
  against.configure({500, CosineWindow::hann, Rotation::counter_clockwise});
  bool same = true;
  for (int i = 0; i < 3000; ++i) {
    const float x = noise(random);
    const float y = noise(random);
    const float a = std::fmod(0.11F * static_cast<float>(i), 6.2831853F);
    with.process(x, -y, a);
    against.process(x, y, a);
    same = same && with.state().radius == against.state().radius &&
           with.state().output.x == against.state().output.x &&
           with.state().output.y == -against.state().output.y;
  }
  CHECK(same);
}

// A force that turns with the spindle stays whole while the speed changes; with a fixed frequency,
// as in the source, it is lost.
void follows_the_speed() {
  for (const double rate : {0.1, 0.5}) {  // part of the base speed per second
    RotationalFilter<float, 500> by_angle;
    RotationalFilter<float, 500> by_time;
    by_angle.configure({});
    by_time.configure({});
    double turns = 0;
    double worst = 0;
    double least = 1000;
    for (int i = 0; i < 4000; ++i) {
      const double t = i / kRate;
      turns = 150 * (t - 0.5 * rate * t * t);
      const double a = kTwoPi * (turns - std::floor(turns));
      const double fixed = kTwoPi * (150 * t - std::floor(150 * t));
      const auto x = static_cast<float>(1000 * std::sin(a + 0.3));
      const auto y = static_cast<float>(1000 * std::cos(a + 0.3));
      by_angle.process(x, y, static_cast<float>(a));
      by_time.process(x, y, static_cast<float>(fixed));
      if (i < 500) continue;
      worst = std::max(worst, std::abs(static_cast<double>(by_angle.state().radius) - 1000));
      least = std::min(least, static_cast<double>(by_time.state().radius));
    }
    check::figure("speed falls by " + std::to_string(rate) + "/s: error of 1000 N, by angle", worst,
                  "N");
    check::figure("  what a fixed frequency leaves of 1000 N", least, "N");
    // A steady vector is the worst for rounding: N additions to a sum that grows to N times 1000 N,
    // each within half a unit of the last place, N 2^-24 / 2 of it when all err the same way.
    CHECK_BETWEEN(worst, 0.0, 1000 * 500 * std::pow(2.0, -24) / 2);
    if (rate > 0.4) CHECK(least < 100);
  }
}

template <typename Real>
void faults() {
  const Real nan = std::numeric_limits<Real>::quiet_NaN();
  const Real inf = std::numeric_limits<Real>::infinity();
  for (int input = 0; input < 3; ++input)
    for (const Real bad : {nan, inf, -inf, static_cast<Real>(1e30)}) {
      RotationalFilter<Real, 100> faulty;
      RotationalFilter<Real, 100> clean;
      faulty.configure({100, CosineWindow::hann, Rotation::clockwise});
      clean.configure({100, CosineWindow::hann, Rotation::clockwise});
      int held = 0;
      for (int i = 0; i < 900; ++i) {
        const bool hit = i == 0 || i == 250 || (i >= 400 && i < 600);
        held += hit;
        const auto a = static_cast<Real>(std::fmod(0.25 * i, kTwoPi));
        const Real x = 5 * std::sin(a) + 1;
        const Real y = 5 * std::cos(a) - 1;
        const Real was = faulty.state().radius;
        faulty.process(hit && input == 0 ? bad : x, hit && input == 1 ? bad : y,
                       hit && input == 2 ? bad : a);
        clean.process(x, y, a);
        CHECK(faulty.state().input_held == hit);
        CHECK(servosense::is_finite(faulty.state().radius));
        CHECK(servosense::is_finite(faulty.state().output.x));
        CHECK(servosense::is_finite(faulty.state().output.y));
        // A stand-in carries the rotating part on: 200 of them, two windows, do not let it go.
        if (hit && i >= 400) CHECK_NEAR(static_cast<double>(faulty.state().radius / was), 1, 0.03);
        if (i == 599) CHECK_BETWEEN(static_cast<double>(faulty.state().radius), 4.5, 5.5);
        if ((i >= 350 && i < 400) || i >= 700)
          CHECK_NEAR(static_cast<double>(faulty.state().radius),
                     static_cast<double>(clean.state().radius), 1e-5);
      }
      CHECK(faulty.state().held == static_cast<std::uint64_t>(held));
    }
  // A restart leaves nothing behind.
  RotationalFilter<Real, 100> again;
  RotationalFilter<Real, 100> fresh;
  again.configure({100, CosineWindow::blackman, Rotation::clockwise});
  fresh.configure({100, CosineWindow::blackman, Rotation::clockwise});
  for (int i = 0; i < 333; ++i) again.process(1000, -1000, 1);
  again.reset();
  bool same = true;
  for (int i = 0; i < 333; ++i) {
    const auto a = static_cast<Real>(std::fmod(0.25 * i, kTwoPi));
    same = same && again.process(1, 2 * a, a) == fresh.process(1, 2 * a, a);
  }
  CHECK(same);
  // Once round the ring nothing is left of what came before, to the last bit, whatever it was.
  RotationalFilter<Real, 100> old;
  fresh.reset();
  old.configure({100, CosineWindow::blackman, Rotation::clockwise});
  for (int i = 0; i < 5000; ++i) old.process(1e6, -1000, static_cast<Real>(i % 6));
  for (int i = 0; i < 333; ++i) {
    const auto a = static_cast<Real>(std::fmod(0.25 * i, kTwoPi));
    old.process(1, 2 * a, a);
    fresh.process(1, 2 * a, a);
    same = same && (i < 100 || old.state().radius == fresh.state().radius);
  }
  CHECK(same);
  // Exact zeros, air cutting, after a cut.
  for (int i = 0; i < 1000; ++i) again.process(0, 0, static_cast<Real>(std::fmod(0.1 * i, kTwoPi)));
  CHECK(again.state().radius == 0);

  CHECK_TEXT((RotationalFilter<Real, 100>::validate({101, {}, {}}).parameter()), "window_samples");
  CHECK_TEXT((RotationalFilter<Real, 100>::validate({7, {}, {}}).parameter()), "window_samples");
  CHECK((RotationalFilter<Real, 100>::validate({100, {}, {}}).ok()));
  static_assert(std::is_trivially_copyable_v<typename RotationalFilter<Real, 100>::State>);
}

// Hours at 8 kHz in float, beside a running sum of the same products that never starts anew.
void hours_of_samples(int hours) {
  constexpr std::size_t kN = 500;
  constexpr std::size_t kTable = 65521;  // a prime: no period of the window
  constexpr std::size_t kTurns = 499;    // steps to 31 turns
  constexpr std::uint64_t kHour = 8000ULL * 3600;
  std::mt19937 random(6);
  std::normal_distribution<double> noise(0, 5);
  std::vector<float> x(kTable);
  std::vector<float> y(kTable);
  for (std::size_t i = 0; i < kTable; ++i) {
    x[i] = static_cast<float>(100 + noise(random));
    y[i] = static_cast<float>(-40 + noise(random));
  }
  std::vector<float> angle(kTurns);
  std::vector<float> cosine(kTurns);
  std::vector<float> sine(kTurns);
  for (std::size_t i = 0; i < kTurns; ++i) {
    angle[i] = static_cast<float>(kTwoPi * static_cast<double>(i * 31 % kTurns) / kTurns);
    cosine[i] = std::cos(angle[i]);
    sine[i] = std::sin(angle[i]);
  }
  auto block = std::make_unique<RotationalFilter<float, kN>>();
  block->configure({kN, CosineWindow::hann, Rotation::clockwise});

  std::vector<float> products(kN, 0.0F);
  float kept = 0;
  double worst = 0;
  double kept_worst = 0;
  std::size_t at = 0;
  std::size_t turn = 0;
  std::size_t slot = 0;
  for (int hour = 1; hour <= hours; ++hour) {
    for (std::uint64_t i = 0; i < kHour; ++i) {
      const float in_x = x[at] + 20 * sine[turn];  // 20 N that turn with the angle
      const float in_y = y[at] + 20 * cosine[turn];
      block->process(in_x, in_y, angle[turn]);
      const float product = in_x * cosine[turn];
      kept += product - products[slot];
      products[slot] = product;
      if (++slot == kN) slot = 0;
      if (++at == kTable) at = 0;
      if (++turn == kTurns) turn = 0;
    }
    Motion m;
    double flat = 0;
    for (std::size_t i = 0; i < kN; ++i) {
      const std::size_t from = (at + kTable - kN + i) % kTable;
      const std::size_t step = (turn + 2 * kTurns - kN + i) % kTurns;
      m.x.push_back(static_cast<double>(x[from] + 20 * sine[step]));
      m.y.push_back(static_cast<double>(y[from] + 20 * cosine[step]));
      m.angle.push_back(static_cast<double>(angle[step]));
      flat += static_cast<double>(products[i]);
    }
    const auto exact = written_out(m, kN - 1, kN, CosineWindow::hann, Rotation::clockwise);
    const auto& s = block->state();
    worst = std::max(worst, std::hypot(static_cast<double>(s.output.x) - exact.x,
                                       static_cast<double>(s.output.y) - exact.y));
    kept_worst = std::max(kept_worst, std::abs(static_cast<double>(kept) - flat) / kN);
  }
  check::figure("hours at 8 kHz, float, 100 N at rest, 20 N turning, noise", hours, "h");
  check::figure("  error, this block", worst, "N");
  check::figure("  error of one running sum of the products that is never begun anew", kept_worst,
                "N");
  // 5e-6 of the vector that turns, as the header states for a steady one.
  CHECK_BETWEEN(worst, 0.0, 5e-6 * 20);
}

}  // namespace

int main(int argc, char** argv) {
  equals_definition();
  length_is_exact();
  radius_law();
  frequency_response();
  rotations_mirror();
  follows_the_speed();
  faults<float>();
  faults<double>();
  const bool nightly = check::nightly(argc, argv);
  hours_of_samples(nightly ? 24 : 1);
  return check::done();
}
