// Friction effects against their equations in <cmath>, and the bristle against its differential
// equation.
#include <algorithm>
#include <limits>
#include <random>

#include "check.hpp"
#include "effects_by_hand.hpp"

using namespace effect_test;

namespace {

// Memoryless effects, written out in double.
template <typename Real>
void formulas() {
  const auto eps = static_cast<double>(std::numeric_limits<Real>::epsilon());
  const unsigned seed = 41;
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  auto coulomb = made<CoulombFriction<Real>>({{31}});
  auto stribeck = made<StribeckFriction<Real>>({{40}, {0.004}});
  auto asymmetric = made<AsymmetricFriction<Real>>({{120}, {9}});
  auto drag = made<QuadraticDrag<Real>>({{-37}});
  auto load = made<LoadDependentFriction<Real>>({{0.07}});
  const int before = check::failures;
  for (int i = 0; i < 1000; ++i) {
    MotionState<Real> m;
    m.velocity = static_cast<Real>(0.5 * unit(random) * unit(random) * unit(random));
    m.direction = static_cast<Real>(unit(random));
    m.effort = static_cast<Real>(1000 * unit(random));
    const double v = static_cast<double>(m.velocity), s = static_cast<double>(m.direction);
    const double u = static_cast<double>(m.effort);
    const auto same = [&](Real force, double expected, double scale) {
      CHECK_NEAR(static_cast<double>(force), expected, scale * std::max(3e-7, 8 * eps));
    };
    same(coulomb.force(m), 31 * s, 31);
    // 3e-7 is the stated error of exp_negative; its argument's own rounding grows with (v/vs)^2,
    // where the exponential has long vanished.
    same(stribeck.force(m), 40 * std::exp(-std::pow(v / 0.004, 2)) * s, 40);
    same(asymmetric.force(m), 60 * std::abs(v) + 4.5 * std::abs(s), 65);
    same(drag.force(m), -37 * v * std::abs(v), 37);
    same(load.force(m), 0.07 * std::abs(u) * s, 70);
  }
  if (check::failures != before) std::cout << "seed " << seed << '\n';
  CHECK(static_cast<double>(made<ViscousFriction<Real>>({{250}}).viscous()) == 250);
}

// dF/dx = s (1 - F/Fb sgn dx), by Runge-Kutta in nanometre steps along the same path.
struct Dahl {
  double stiffness, breakaway, force = 0;
  void travel(double dx) {
    const int steps = 1 + static_cast<int>(std::abs(dx) / 1e-9);
    const double h = dx / steps, sign = dx < 0 ? -1 : 1;
    const auto slope = [&](double F) { return stiffness * (1 - F / breakaway * sign); };
    for (int i = 0; i < steps; ++i) {
      const double k1 = slope(force), k2 = slope(force + h / 2 * k1);
      const double k3 = slope(force + h / 2 * k2), k4 = slope(force + h * k3);
      force += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    }
  }
};

template <typename Real>
void bristle(double tolerance) {
  const double breakaway = 60, stiffness = 2e6;  // 30 um
  auto effect = made<PreslidingHysteresis<Real>>({{stiffness}, {breakaway}});
  Dahl oracle{stiffness, breakaway};
  Path<Real> path;
  path.knee = 5e-6;
  double worst = 0, force = 0;
  for (int n = 0; n < 4000; ++n) {
    // Loops within loops, with steps up to 4 um.
    const double x = 1e-4 * std::sin(0.01 * n) + 4e-5 * std::sin(0.043 * n);
    const double last = path.last;
    const MotionState<Real>& m = path.to(x);
    force = static_cast<double>(effect.force(m));
    oracle.travel(x - last);
    worst = std::max(worst, std::abs(force - (oracle.force - breakaway * path.sign)));
  }
  CHECK_NEAR(worst, 0, tolerance);
  // Sliding on, bristle and sign agree: the effect adds nothing to sliding friction.
  for (int n = 0; n < 100; ++n)
    force = static_cast<double>(effect.force(path.to(path.last + 1e-5)));
  CHECK_NEAR(force, 0, 60 * 1e-6);
  // Rate independence: the same path in four times as many samples.
  auto coarse = made<PreslidingHysteresis<Real>>({{stiffness}, {breakaway}});
  auto fine = made<PreslidingHysteresis<Real>>({{stiffness}, {breakaway}});
  Path<Real> slow, fast;
  slow.knee = fast.knee = 5e-6;
  for (int n = 1; n <= 40; ++n) {
    const double x = (n <= 20 ? n : 40 - n) * 1e-6;
    const double a = static_cast<double>(coarse.force(fast.to(x)));
    double b = 0;
    const double from = slow.last;
    for (int i = 1; i <= 4; ++i)
      b = static_cast<double>(fine.force(slow.to(from + (x - from) * i / 4)));
    CHECK_NEAR(a, b, 60 * 2e-6);
  }
}

void profile() {
  // Knots at -0.1, 0, 0.2, 0.25 with friction 5, 10, 10, -2.
  auto effect = made<PositionDependentFriction<double>>({{-0.1, 5, 0, 10, 0.2, 10, 0.25, -2}});
  const double rows[][2] = {{-1, 5},   {-0.1, 5},  {-0.05, 7.5}, {0, 10},   {0.1, 10},
                            {0.2, 10}, {0.225, 4}, {0.25, -2},   {0.26, -2}};
  for (const auto& row : rows) {
    MotionState<double> m;
    m.position = row[0];
    m.direction = -0.5;
    CHECK_NEAR(effect.force(m), -0.5 * row[1], 1e-12);
  }
  using Effects = DriveEffects<double>;
  CHECK(Effects::validate(config("position-dependent-friction", {{0, 1, 1, 2}})).ok());
  CHECK(!Effects::validate(config("position-dependent-friction", {{0, 1, 1}})).ok());
  CHECK(!Effects::validate(config("position-dependent-friction", {{1, 1, 0, 2}})).ok());
}

template <typename Real>
void warming(double tolerance) {
  DriveFacts facts;
  auto effect = made<ThermalFrictionDrift<Real>>({{55}, {600}}, facts);
  MotionState<Real> m;
  m.direction = -1;
  double worst = 0, force = 0;
  const int hour = 8000 * 3600;
  for (int n = 1; n <= hour; ++n) {
    force = static_cast<double>(effect.force(m));
    if (n % 7919 == 0) {
      const double t = n * 125e-6;
      worst = std::max(worst, std::abs(force + 55 * (1 - std::exp(-t / 600))));
    }
    if (n == hour / 2) effect.restart();  // a gap in the data does not cool the drive
  }
  check::figure("warming over an hour, largest error", worst, "N");
  CHECK_NEAR(worst, 0, tolerance);
  effect.reset();
  CHECK_NEAR(static_cast<double>(effect.force(m)), 0, 1e-6);
}

}  // namespace

int main() {
  formulas<float>();
  formulas<double>();
  // Exponentials good to 3e-7 relative, errors that fade with the travel; float rounds the
  // increments too.
  bristle<double>(60 * 2e-6);
  bristle<float>(60 * 2e-5);
  profile();
  // Steps of tau/1000 move the force by a thousandth of the change.
  warming<double>(55 * 1.001e-3);
  warming<float>(55 * 1.02e-3);
  return check::done();
}
