// Mean torque and forces of a cut in closed form against numerical quadrature of the force law.
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/model/average_cutting.hpp"

using namespace servosense;

namespace {

/// Gauss-Legendre with five points on many intervals: to rounding for what is smooth.
template <typename F>
double integral(double from, double to, F f) {
  const double x[] = {0, 0.5384693101056831, 0.9061798459386640};
  const double w[] = {0.5688888888888889, 0.4786286704993665, 0.2369268850561891};
  const int parts = 64;
  double sum = 0;
  for (int p = 0; p < parts; ++p) {
    const double half = (to - from) / parts / 2, middle = from + (2 * p + 1) * half;
    sum += half * w[0] * f(middle);
    for (int i = 1; i < 3; ++i)
      sum += half * w[i] * (f(middle - half * x[i]) + f(middle + half * x[i]));
  }
  return sum;
}

double of(const AverageShare& a, const double (&k)[6]) {
  return a.tangential * k[0] + a.tangential_edge * k[1] + a.radial * k[2] + a.radial_edge * k[3] +
         a.axial * k[4] + a.axial_edge * k[5];
}

/// The same with teeth that run out, each summed over its own chips as the teeth before it leave
/// them (Kline and DeVor 1983).
void run_out(std::mt19937_64& bits) {
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(bits);
  };
  int missed = 0;
  for (int n = 0; n < 60; ++n) {
    const int teeth = 1 + n % 5;
    const double radius = between(2e-3, 0.02), depth = between(1e-3, 0.01),
                 feed = between(1e-5, 2e-4), out = between(0, 2) * feed;
    const double a = between(0, kPi), b = between(0, kPi);
    const Engagement engagement{std::min(a, b), std::max(a, b)};
    const double k[6] = {between(1e8, 3e9), between(1e3, 5e4), between(1e8, 1e9),
                         between(1e3, 5e4), between(1e7, 5e8), between(1e2, 1e4)};
    std::vector<double> thrown;
    for (int j = 0; j < teeth; ++j) thrown.push_back(between(-out, out));
    double torque = 0, x = 0, y = 0, z = 0, size = 0;
    const int steps = 20000;
    const double step = engagement.swept_rad() / steps;
    for (int j = 0; j < teeth; ++j)
      for (int i = 0; i < steps; ++i) {
        const double phi = engagement.start_rad + (i + 0.5) * step;
        double chip = teeth * feed * std::sin(phi);
        for (int back = 1; back < teeth; ++back)
          chip = std::min(chip, back * feed * std::sin(phi) + thrown[static_cast<std::size_t>(j)] -
                                    thrown[static_cast<std::size_t>((j + teeth - back) % teeth)]);
        if (chip < 0) {
          ++missed;
          continue;
        }
        const double share = depth * step / kTwoPi;
        const double ft = share * (k[0] * chip + k[1]), fr = share * (k[2] * chip + k[3]);
        torque += radius * ft;
        x += -ft * std::cos(phi) - fr * std::sin(phi);
        y += ft * std::sin(phi) - fr * std::cos(phi);
        z += share * (k[4] * chip + k[5]);
        size += ft + fr;
      }
    const AverageCutting average = average_cutting(teeth, radius, depth, feed, engagement, thrown);
    // The sum has an edge wrong by a step where a tooth meets its chip.
    CHECK_NEAR(of(average.torque, k) / torque, 1, 1e-3);
    CHECK_NEAR((of(average.x, k) - x) / size, 0, 1e-3);
    CHECK_NEAR((of(average.y, k) - y) / size, 0, 1e-3);
    CHECK_NEAR(of(average.z, k) / z, 1, 1e-3);
  }
  CHECK(missed > 60 * 1000);  // teeth do miss their chips
}

}  // namespace

int main() {
  std::mt19937_64 bits(20261);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(bits);
  };
  for (int n = 0; n < 200; ++n) {
    const int teeth = 1 + n % 8;
    const double radius = between(1e-3, 0.05), depth = between(1e-4, 0.02),
                 feed = between(1e-5, 5e-4);
    const double a = between(0, kPi), b = between(0, kPi);
    const Engagement engagement{std::min(a, b), std::max(a, b)};
    const double k[6] = {between(1e8, 3e9), between(1e3, 5e4), between(1e8, 1e9),
                         between(1e3, 5e4), between(1e7, 5e8), between(1e2, 1e4)};
    const AverageCutting average = average_cutting(teeth, radius, depth, feed, engagement);
    // A tooth at phi stands at R (sin phi, cos phi) and moves along (cos phi, -sin phi): the force
    // on it is against that and, radially, towards the axis.
    const auto mean = [&](auto f) {
      return teeth / kTwoPi * integral(engagement.start_rad, engagement.exit_rad, f);
    };
    const auto ft = [&](double phi) { return depth * (k[0] * feed * std::sin(phi) + k[1]); };
    const auto fr = [&](double phi) { return depth * (k[2] * feed * std::sin(phi) + k[3]); };
    const auto fa = [&](double phi) { return depth * (k[4] * feed * std::sin(phi) + k[5]); };
    const double torque = mean([&](double p) { return radius * ft(p); });
    const double x = mean([&](double p) { return -ft(p) * std::cos(p) - fr(p) * std::sin(p); });
    const double y = mean([&](double p) { return ft(p) * std::sin(p) - fr(p) * std::cos(p); });
    const double z = mean(fa);
    const double size = mean([&](double p) { return std::abs(ft(p)) + std::abs(fr(p)); });
    CHECK_NEAR(of(average.torque, k) / torque, 1, 1e-12);
    CHECK_NEAR((of(average.x, k) - x) / size, 0, 1e-12);
    CHECK_NEAR((of(average.y, k) - y) / size, 0, 1e-12);
    CHECK_NEAR(of(average.z, k) / z, 1, 1e-12);
  }
  // Dunwoody 2010, eq. 3.19: the slot.
  const AverageCutting slot = average_cutting(2, 0.01, 0.003, 1e-4, {0, kPi});
  CHECK_NEAR(slot.torque.tangential, 0.01 * 2 * 0.003 / kPi * 1e-4, 1e-20);
  CHECK_NEAR(slot.torque.tangential_edge, 0.01 * 2 * 0.003 / 2, 1e-16);
  run_out(bits);
  return check::done();
}
