// Friction learned in the air: against least squares, for a day, and with values that may be a cut.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>

#include "check.hpp"
#include "servosense/monitors/friction_drift.hpp"
#include "servosense/sim/gaussian_noise.hpp"

namespace {

using namespace servosense;

/// Friction of an axis that drills at 0.1 m/s at most and has rapids of 0.83 m/s.
FrictionDriftConfig drilling_axis() {
  FrictionDriftConfig c;
  c.friction_error = 100;
  c.noise = 10;
  c.usual_speed = 0.1;
  c.reference_speed = 0.83;
  return c;
}

// Without drift the filter is least squares with the start as its prior: against normal equations
// solved by Cramer's rule.
template <typename Real>
void friction_is_least_squares() {
  for (const std::uint64_t seed : {3U, 4U, 5U}) {
    GaussianNoise random(seed);
    FrictionDriftConfig c = drilling_axis();
    c.offset_error = 60;
    FrictionDrift<Real> filter;
    filter.configure(c);
    typename FrictionDrift<Real>::State s;
    filter.reset(s);
    double m[3][4] = {{1.0 / 3600, 0, 0, 0}, {0, 1e-4, 0, 0}, {0, 0, 1e-4, 0}};
    for (int n = 0; n < 60; ++n) {
      const double v = (random.uniform() < 0.5 ? -1 : 1) * (n % 3 == 0 ? 0.8 : 0.03);
      const double h[3] = {1, v > 0 ? 1.0 : -1.0, v / 0.83};
      const double value = 12 - 35 * h[1] + 48 * h[2] + 10 * random.next();
      const double weight = 1 / (100 * (std::abs(v) > 0.1 ? 1 + v * v / 0.01 : 1));
      filter.learn(s, static_cast<Real>(value), static_cast<Real>(v), false);
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) m[i][j] += weight * h[i] * h[j];
        m[i][3] += weight * h[i] * value;
      }
    }
    auto det = [&](int replaced) {
      double a[3][3];
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) a[i][j] = m[i][j == replaced ? 3 : j];
      return a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) -
             a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0]) +
             a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]);
    };
    const std::string what = "friction by least squares, seed " + std::to_string(seed);
    const double tolerance = std::is_same_v<Real, float> ? 5e-3 : 1e-9;
    for (int i = 0; i < 3; ++i)
      check::near(static_cast<double>(s.x[static_cast<std::size_t>(i)]), det(i) / det(-1),
                  tolerance, what.c_str(), __FILE__, __LINE__);
    // Its variance is that of the normal equations: cc of the inverse.
    const double cc = (m[0][0] * m[2][2] - m[0][2] * m[2][0]) / det(-1);
    check::near(static_cast<double>(s.p[3]) / cc, 1.0, 1e-3, what.c_str(), __FILE__, __LINE__);
  }
}

// A day of it, air cutting and standstill, in float: stays finite, positive, and right.
void friction_for_a_day() {
  FrictionDriftConfig c = drilling_axis();
  c.offset_error = 100;
  c.drift = 3.2;
  FrictionDrift<float> filter;
  filter.configure(c);
  FrictionDrift<float>::State s;
  filter.reset(s);
  GaussianNoise random(6);
  bool positive = true;
  for (int n = 0; n < 8'640'000; ++n) {  // parts of 10 ms
    filter.elapse(s, 0.01F);
    if (n % 360'000 < 60'000) continue;  // ten minutes of rest in the hour
    const float v = n % 40 < 20 ? 0.03F : -0.8F;
    if (n % 4 == 0)
      filter.learn(s, (v > 0 ? 20.0F : -30.0F) + 10 * static_cast<float>(random.next()), v, true);
    for (const std::size_t i : {0U, 3U, 5U}) positive = positive && s.p[i] >= 0 && s.p[i] <= 1e4F;
  }
  CHECK(positive);
  CHECK_NEAR(static_cast<double>(filter.at(s, 0.03F)), 20.0,
             3.0);  // sigma about 1.3 N from drift 0.32 N a part
  CHECK(filter.variance(s, 0.03F) > 0 && filter.variance(s, 0.03F) < 25);
}

// Soft contact is not learned as friction; the same value in a rapid is.
void doubtful_values() {
  FrictionDriftConfig c;
  c.friction_error = 50;
  c.noise = 5;
  c.usual_speed = 0.1;
  FrictionDrift<double> filter;
  filter.configure(c);
  FrictionDrift<double>::State s;
  filter.reset(s);
  for (int n = 0; n < 50; ++n) filter.learn(s, 10, 0.03, true);
  CHECK_NEAR(filter.at(s, 0.03), 10.0, 0.1);
  filter.learn(s, 60, 0.03, true);
  CHECK_NEAR(filter.at(s, 0.03), 10.0, 0.1);
  filter.learn(s, 60, 0.03, false);
  CHECK(filter.at(s, 0.03) > 10.5);
}

}  // namespace

int main() {
  friction_is_least_squares<double>();
  friction_is_least_squares<float>();
  friction_for_a_day();
  doubtful_values();
  return check::done();
}
