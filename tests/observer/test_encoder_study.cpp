// How many encoder bits an observer needs (Koike 2016, section 3.3): constant speed, angle cut to
// whole counts at 8 kHz, largest line of the estimate. Counts are made in integers; lines by the
// direct transform over whole periods of the pattern (the speeds alias to 1/15 and 1/3 of the
// rate).
#include <algorithm>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace {

using namespace servosense;
constexpr std::size_t kRecord = 3840;  // 256 times 15

struct Drive {
  double inertia;
  double unit_per_turn;
  std::int64_t turns, samples;  // speed as a fraction: turns in so many samples
};
constexpr Drive kSpindle{0.0048, kTwoPi, 1, 30};              // 16000 rpm at 8 kHz
Drive stage(double mass) { return {mass, 0.016, 25, 3840}; }  // 3125 rpm

template <typename Real>
double largest_line(const Drive& drive, int bits, double g, Discretisation d) {
  DisturbanceObserverConfig c;
  c.disturbance_cutoff_rad_s = c.velocity_cutoff_rad_s = g;
  c.discretisation = d;
  c.drive.inertia = drive.inertia;
  DisturbanceObserver<Real> observer;
  observer.configure(c);
  const std::int64_t counts = std::int64_t{1} << bits;
  const double unit = drive.unit_per_turn / static_cast<double>(counts);
  std::vector<double> y(kRecord);
  std::int64_t last = 0;
  for (std::size_t n = 0; n < 2 * kRecord; ++n) {  // the first half lets the filters settle
    const std::int64_t now = static_cast<std::int64_t>(n) * counts * drive.turns / drive.samples;
    DriveSample<Real> s;
    s.increment = static_cast<Real>(static_cast<double>(now - last) * unit);
    last = now;
    y[n % kRecord] = static_cast<double>(observer.process(s));
  }
  double largest = 0;
  for (std::size_t k = 1; k <= kRecord / 2; ++k) {
    double re = 0, im = 0;
    for (std::size_t n = 0; n < kRecord; ++n) {
      static const std::vector<double> cosine = [] {
        std::vector<double> t(kRecord);
        for (std::size_t i = 0; i < kRecord; ++i)
          t[i] = std::cos(kTwoPi * static_cast<double>(i) / static_cast<double>(kRecord));
        return t;
      }();
      const std::size_t at = k * n % kRecord;
      re += y[n] * cosine[at];
      im += y[n] * cosine[(at + kRecord / 4) % kRecord];
    }
    const double both_sides = k == kRecord / 2 ? 1.0 : 2.0;
    largest = std::max(largest, both_sides * std::hypot(re, im) / static_cast<double>(kRecord));
  }
  return largest;
}

double line(const Drive& drive, int bits, double g, Discretisation d = Discretisation::tustin) {
  return largest_line<double>(drive, bits, g, d);
}

void spindle() {
  std::map<int, double> at4000;
  for (const int bits : {10, 14, 16, 17, 18, 20}) {
    at4000[bits] = line(kSpindle, bits, 4000);
    check::figure("spindle, 4000 rad/s, " + std::to_string(bits) + " bits", at4000[bits], "Nm");
  }
  // Reproduced figures, to the digits in which they are stated.
  CHECK_NEAR(at4000[10], 115, 0.5);
  CHECK_NEAR(at4000[14], 7.2, 0.05);
  CHECK_NEAR(at4000[16], 2.36, 0.005);
  CHECK_NEAR(at4000[17], 0.495, 0.0005);
  CHECK_NEAR(at4000[18], 0.45, 0.005);
  CHECK_NEAR(at4000[20], 0.148, 0.001);  // exact counts give 0.1475, one unit of the last digit off
  CHECK(at4000[17] < 1 && at4000[16] > 1);  // the source: 1 Nm needs 17 bits
  const double a = line(kSpindle, 17, 3500), b = line(kSpindle, 20, 3500),
               c = line(kSpindle, 17, 1000);
  CHECK_NEAR(a, 0.44, 0.005);
  CHECK_NEAR(b, 0.11, 0.005);
  CHECK_NEAR(c, 0.068, 0.0005);
  CHECK(c < a && a < at4000[17]);  // grows with the cutoff
}

void stage_axes() {
  const double z10 = line(stage(380), 10, 4000), z16 = line(stage(380), 16, 4000),
               z17 = line(stage(380), 17, 4000), z18 = line(stage(380), 18, 4000),
               z20 = line(stage(380), 20, 4000);
  check::figure("Z stage, 4000 rad/s, 20 bits", z20, "N");
  CHECK_NEAR(z10, 3.58e4, 50);
  CHECK_NEAR(z16, 560, 0.5);
  CHECK_NEAR(z17, 280, 0.5);
  CHECK_NEAR(z18, 140, 0.5);
  CHECK_NEAR(z20, 35.0, 0.05);
  CHECK_BETWEEN(z20, 30, 40);  // the source's 36 N
  CHECK_NEAR(line(stage(227), 20, 4000), 20.9, 0.05);
  CHECK_NEAR(line(stage(325), 20, 4000), 29.9, 0.05);
  const double euler = line(stage(380), 20, 4000, Discretisation::backward_euler);
  check::figure("Z stage, 4000 rad/s, 20 bits, backward Euler", euler, "N");
  CHECK_NEAR(euler, 22.6, 0.05);
  // In float the same line, to the rounding of the inertia term.
  CHECK_NEAR(largest_line<float>(stage(380), 20, 4000, Discretisation::tustin), z20, 0.05);
  // Halved by each bit where the pattern stays the same.
  CHECK_NEAR(z16 / z17, 2.0, 0.01);
  CHECK_NEAR(z17 / z18, 2.0, 0.01);
}

}  // namespace

int main() {
  spindle();
  stage_axes();
  return check::done();
}
