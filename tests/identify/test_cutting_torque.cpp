// What an idling spindle teaches of the torque that means cutting: its speed changes, in which the
// inertia may be off, do not count.
#include <cmath>
#include <cstdio>

#include "check.hpp"
#include "servosense/identify/learn_thresholds.hpp"

using namespace servosense;

namespace {

constexpr double kPeriod_s = 1e-3;
constexpr double kInertia_kg_m2 = 0.02, kCoulomb_Nm = 1;

DisturbanceObserverConfig observer(double inertia_kg_m2) {
  DisturbanceObserverConfig c;
  c.sample_period_s = kPeriod_s;
  c.drive.inertia = inertia_kg_m2;
  c.drive.coulomb = kCoulomb_Nm;
  c.drive.friction_knee = 0.01;
  return c;
}

CutDetectorConfig detector() {
  CutDetectorConfig c;
  c.sample_period_s = kPeriod_s;
  return c;
}

/// A spindle whose friction is `more` than the model's, at 100, 200 and 300 rad/s, each for
/// `hold_s`, with 500 rad/s2 between.
DriveRecord idle(double more_Nm, double hold_s) {
  DriveRecord r;
  r.sample_period_s = kPeriod_s;
  double speed = 0, angle = 0;
  for (const double target : {100.0, 200.0, 300.0}) {
    const auto add = [&](double acceleration) {
      const double step = (speed + 0.5 * acceleration * kPeriod_s) * kPeriod_s;
      speed += acceleration * kPeriod_s;
      angle += step;
      DriveSample<double> s;
      s.increment = step;
      s.position = angle;
      s.turn_angle_rad = std::fmod(angle, kTwoPi);
      s.effort = kInertia_kg_m2 * acceleration + kCoulomb_Nm + more_Nm;
      r.samples.push_back(s);
    };
    while (speed < target - 1e-9) add(500);
    for (double t = 0; t < hold_s; t += kPeriod_s) add(0);
  }
  return r;
}

}  // namespace

int main() {
  // 20 % off in inertia is 2 Nm in a change of speed; the steady air is 0.1 Nm off.
  const auto off = observer(0.8 * kInertia_kg_m2);
  const double steady = learn_cutting_torque(off, detector(), idle(0.1, 2));
  check::figure("speeds held for 2 s", steady, "Nm");
  CHECK_NEAR(steady, 1.5 * 0.1, 0.01);
  // Without a steady speed there is nothing better than the highest of all.
  const double hurried = learn_cutting_torque(off, detector(), idle(0.1, 0.2));
  check::figure("speeds held for 0.2 s", hurried, "Nm");
  CHECK_BETWEEN(hurried, 1.5 * 1.5, 1.5 * 2.2);
  CHECK(learn_cutting_torque(off, detector(), DriveRecord{}) == 0);
  return check::done();
}
