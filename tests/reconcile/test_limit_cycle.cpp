// A drive that swings all the time: its line is found, it is no noise of the encoder, and what
// friction does under it gets no name.
#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "check.hpp"
#include "reconcile/drive/comparison_band.hpp"
#include "reconcile/drive/limit_cycle.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kTurn = 6.283185307179586;
constexpr double kPeriod = 1e-3;
constexpr double kMass = 100;
constexpr double kCoulomb = 80, kStatic = 40, kStribeck = 2e-3;

struct Case {
  double swing_m = 0, swing_hz = 0;
  double noise_m = 2e-8;
  double quantum_m = 0;
  double share = 1;      // of the time in which it swings
  double per_metre = 0;  // instead of with time, once in so much travel
  double seconds = 12;
};

/// Speeds of 60 mm/s to 0.6 mm/s, both ways, ramps in closed form: x is a sum of sines whose speed
/// is what was asked for at every time scale. Friction with a Stribeck bell at the speed of the
/// stage, which does not swing.
DriveData record(const Case& c) {
  DriveData d;
  d.sample_period_s = d.servo_period_s = kPeriod;
  d.model.inertia = 1.05 * kMass;
  d.model.coulomb = 0.95 * kCoulomb;
  d.model.viscous = 200;
  d.observer.drive = d.model;
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise;
  double last = 0;
  const auto n = static_cast<int>(c.seconds / kPeriod);
  for (int i = 0; i < n; ++i) {
    const double t = i * kPeriod;
    const double slow = kTurn * 0.25, quick = kTurn * 1.7;
    const double x = 0.02 * std::sin(slow * t) + 8e-4 * std::sin(quick * t);
    const double v = 0.02 * slow * std::cos(slow * t) + 8e-4 * quick * std::cos(quick * t);
    const double a =
        -0.02 * slow * slow * std::sin(slow * t) - 8e-4 * quick * quick * std::sin(quick * t);
    const bool has_limit_cycle = std::fmod(t, 1.0) < c.share;
    const double phase = c.per_metre > 0 ? kTurn * x / c.per_metre : kTurn * c.swing_hz * t;
    const double limit_cycle = has_limit_cycle ? c.swing_m * std::sin(phase) : 0;
    double measured = x + limit_cycle + c.noise_m * noise(random);
    if (c.quantum_m > 0) measured = c.quantum_m * std::floor(measured / c.quantum_m);
    const double sign = std::tanh(v / 2e-5);
    DriveSample<double> sample;
    sample.increment = i == 0 ? 0 : measured - last;
    sample.position = measured;
    sample.effort = kMass * a + 200 * v +
                    sign * (kCoulomb + kStatic * std::exp(-v * v / kStribeck / kStribeck)) -
                    0.5 * kMass * kTurn * kTurn * c.swing_hz * c.swing_hz * limit_cycle +
                    0.5 * noise(random);
    d.samples.push_back(sample);
    last = measured;
  }
  return d;
}

void a_line_that_stays() {
  for (const double hz : {130.0, 240.0, 330.0}) {
    const LimitCycle limit_cycle = find_limit_cycle(record({.swing_m = 4e-6, .swing_hz = hz}));
    CHECK_NEAR(limit_cycle.frequency_hz, hz, 2);
    CHECK_NEAR(limit_cycle.amplitude, 4e-6, 1e-7);
  }
}

void what_is_no_such_line() {
  CHECK(find_limit_cycle(record({})).frequency_hz == 0);
  CHECK(find_limit_cycle(record({.noise_m = 3e-6})).frequency_hz == 0);
  CHECK(find_limit_cycle(record({.quantum_m = 5e-6})).frequency_hz == 0);
  // Less than a hundredth of the top speed; a third of the time; locked to the place, not to time.
  CHECK(find_limit_cycle(record({.swing_m = 1e-7, .swing_hz = 240})).frequency_hz == 0);
  CHECK(find_limit_cycle(record({.swing_m = 4e-6, .swing_hz = 240, .share = 0.33})).frequency_hz ==
        0);
  CHECK(find_limit_cycle(record({.swing_m = 4e-6, .per_metre = 1e-4})).frequency_hz == 0);
}

/// The encoder's noise is what was drawn: the floor beside a swing is that without one.
void it_is_no_noise() {
  const double without = encoder_floor(record({}), 40);
  const double with = encoder_floor(record({.swing_m = 4e-6, .swing_hz = 240}), 40);
  CHECK(without > 0);
  CHECK_NEAR(with / without, 1, 0.1);
}

void friction_has_no_name_under_it() {
  const auto named = [](const Report& r) {
    return std::any_of(r.effects.begin(), r.effects.end(),
                       [](const FoundEffect& e) { return e.name == "stribeck-friction"; });
  };
  const auto at_rest = reconcile_drive(record({}), {});
  const auto swinging = reconcile_drive(record({.swing_m = 6e-6, .swing_hz = 240}), {});
  CHECK(at_rest.has_value() && swinging.has_value());
  if (!at_rest || !swinging) return;
  CHECK(named(at_rest->report));
  CHECK(at_rest->report.remarks.empty());
  CHECK(!named(swinging->report));
  CHECK(swinging->report.remarks.size() == 1);
  CHECK(swinging->report.remarks[0].find("swings all the time") != std::string::npos);
  for (const RankedCandidate& c : swinging->report.ranking)
    if (c.name == "stribeck-friction") {
      CHECK(c.explained > 0.3);  // it is the swing that speaks against it
      CHECK(c.objection.find("swings at 2") != std::string::npos);
    }
}

}  // namespace

int main() {
  a_line_that_stays();
  what_is_no_such_line();
  it_is_no_noise();
  friction_has_no_name_under_it();
  return check::done();
}
