// Reference motions against hand-worked moves, numerical differentiation and bisection.
#include <algorithm>
#include <cmath>
#include <random>

#include "check.hpp"
#include "servosense/sim/trajectory.hpp"

using servosense::JerkLimitedMove;
using servosense::MotionLimits;
using servosense::MotionPoint;
using servosense::Trajectory;

namespace {

// Time to speed V by elementary kinematics: two jerk segments, and between them the acceleration
// that they reach for as long as it takes.
double time_to_speed(double V, const MotionLimits& m) {
  const double jerk_s = std::min(m.acceleration / m.jerk, std::sqrt(V / m.jerk));
  const double gained = m.jerk * jerk_s * jerk_s;
  return 2 * jerk_s + (V - gained) / (m.jerk * jerk_s);
}

// The speed at which run-up and run-down fill the distance, by bisection.
double duration_by_bisection(double d, const MotionLimits& m) {
  double low = 0, high = m.velocity;
  if (high * time_to_speed(high, m) > d)
    for (int i = 0; i < 200; ++i) {
      const double middle = (low + high) / 2;
      (middle * time_to_speed(middle, m) > d ? high : low) = middle;
    }
  return d / high + time_to_speed(high, m);
}

void hand_worked() {
  struct Row {
    double distance;
    MotionLimits limits;
    double duration;
  };
  const Row rows[] = {
      {10, {1, 1, 1}, 12},                      // all seven segments at the limits
      {20, {10, 1, 1}, 10},                     // reaches 4: no cruise
      {1, {1, 1, 1}, 4 * std::cbrt(0.5)},       // neither cruise nor constant acceleration
      {4, {1, 10, 1}, 6},                       // cruise, acceleration limit never met
      {-0.3, {0.5, 5, 100}, 0.6 + 0.1 + 0.05},  // backward: |d|/v + v/a + a/j
      {0, {1, 1, 1}, 0},
  };
  for (const Row& row : rows) {
    const auto move = JerkLimitedMove::plan(row.distance, row.limits);
    CHECK(move);
    CHECK_NEAR(move->duration_s(), row.duration, 1e-14 * (1 + row.duration));
    CHECK(move->at(move->duration_s()).position == row.distance);
    CHECK(move->at(move->duration_s() + 1).velocity == 0);
  }
}

void random_moves() {
  const unsigned seed = 20160217;
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> exponent(-1, 1);
  const int before = check::failures;
  for (int run = 0; run < 300; ++run) {
    const MotionLimits m{0.3 * std::pow(10, exponent(random)), 3 * std::pow(10, exponent(random)),
                         100 * std::pow(10, 1.5 * exponent(random))};
    const double d = 0.1 * std::pow(10, 2 * exponent(random)) * (run % 2 == 0 ? 1 : -1);
    const auto move = JerkLimitedMove::plan(d, m);
    const double T = move->duration_s();
    CHECK_NEAR(T, duration_by_bisection(std::abs(d), m), 1e-12 * T);
    const double dt = 1e-4 * T;
    for (int i = 1; i < 500; ++i) {
      const double t = T * i / 500;
      const MotionPoint p = move->at(t), next = move->at(t + dt), last = move->at(t - dt);
      // Limits, but for rounding.
      CHECK(std::abs(p.velocity) <= m.velocity * (1 + 1e-12));
      CHECK(std::abs(p.acceleration) <= m.acceleration * (1 + 1e-12));
      CHECK(std::abs(p.jerk) <= m.jerk);
      CHECK(p.velocity * d >= 0);
      // Central differences of a function with third derivative j err by j dt^2/6, of its
      // derivative (whose own derivative jumps by 2j at worst) by j dt; rounding by 2e-16 d/dt.
      const double rounding = 4e-16 * std::abs(d) / dt;
      CHECK_NEAR((next.position - last.position) / (2 * dt), p.velocity,
                 m.jerk * dt * dt / 3 + rounding);
      CHECK_NEAR((next.velocity - last.velocity) / (2 * dt), p.acceleration,
                 m.jerk * dt + rounding / T * 20);
      CHECK(std::abs(next.acceleration - p.acceleration) <=
            m.jerk * dt * (1 + 1e-6) + 1e-10 * m.acceleration);
    }
  }
  if (check::failures != before) std::cout << "seed " << seed << '\n';
}

void program() {
  Trajectory t(0.1);
  const MotionLimits m{0.5, 5, 100};
  CHECK(t.move_to(0.4, m));
  CHECK(t.dwell(0.25));
  CHECK(t.sine(0.01, 5, 3));
  CHECK(t.cruise(-0.4, 0.5, m));
  // 0.3/0.5 + 0.1 + 0.05; dwell; 3 cycles; the run-up to 0.4 m/s takes 0.4/5 + 5/100, twice.
  CHECK_NEAR(t.duration_s(), 0.75 + 0.25 + 0.6 + 2 * 0.13 + 0.5, 1e-12);
  CHECK_NEAR(t.end(), 0.4 - 0.4 * (0.5 + 0.13), 1e-12);
  CHECK(t.at(0).position == 0.1);
  CHECK(t.at(-1).position == 0.1);
  CHECK(t.at(t.duration_s()).position == t.end());
  CHECK_NEAR(t.at(0.75).position, 0.4, 1e-12);
  CHECK(t.at(0.9).position == 0.4 && t.at(0.9).velocity == 0);
  CHECK_NEAR(t.at(1.0 + 0.1).position, 0.42, 1e-12);  // half a cycle: twice the amplitude
  CHECK_NEAR(t.at(1.0 + 0.05).velocity, 0.01 * 2 * 3.14159265358979 * 5, 1e-10);
  double cruising = 0;  // exactly at speed for as long as asked
  for (double s = 1.6; s < t.duration_s(); s += 1e-4)
    if (std::abs(t.at(s).velocity + 0.4) < 1e-12) cruising += 1e-4;
  CHECK_NEAR(cruising, 0.5, 3e-4);
  // No jump anywhere: position and velocity move at most as fast as they may.
  const double fastest = 0.5;
  const double hardest = 0.01 * 31.416 * 31.416;  // the sine's
  for (double s = 0; s < t.duration_s(); s += 1e-4) {
    const MotionPoint a = t.at(s), b = t.at(s + 1e-4);
    CHECK(std::abs(b.position - a.position) <= fastest * 1e-4 * (1 + 1e-9) + 1e-15);
    CHECK(std::abs(b.velocity - a.velocity) <= hardest * 1e-4 + 1e-12);
  }
}

void refusals() {
  CHECK(!JerkLimitedMove::plan(1, {0, 1, 1}));
  CHECK(!JerkLimitedMove::plan(1, {1, -1, 1}));
  CHECK(!JerkLimitedMove::plan(1, {1, 1, std::nan("")}));
  CHECK(!JerkLimitedMove::plan(std::nan(""), {1, 1, 1}));
  Trajectory t;
  CHECK(!t.dwell(-1));
  CHECK(!t.sine(1, 0, 1));
  CHECK(!t.sine(1, 1, 0));
  CHECK(!t.cruise(2, 1, {1, 1, 1}));
  CHECK(!t.cruise(0, 1, {1, 1, 1}));
  CHECK(t.duration_s() == 0);  // what was refused left nothing behind
}

}  // namespace

int main() {
  hand_worked();
  random_moves();
  program();
  refusals();
  return check::done();
}
