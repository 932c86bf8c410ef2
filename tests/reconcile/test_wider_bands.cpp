// A coarse encoder keeps the comparison below the mode of a soft coupling. The record shows the
// mode all the same, in a wider band, and shows none where there is none.
#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "../../src/reconcile/comparison_band.hpp"
#include "../../src/reconcile/drive_signals.hpp"
#include "check.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kTurn = 6.283185307179586;
constexpr double kPeriod = 5e-4;
constexpr double kMass = 100;
constexpr double kShare = 0.35;

DriveData axis(double quantum) {
  DriveData d;
  d.channel = Channel::x;
  d.sample_period_s = d.servo_period_s = kPeriod;
  d.model.inertia = 1.06 * kMass;
  d.model.viscous = 140;
  d.model.coulomb = 42;
  d.model.unit_per_turn = 0.01;
  d.model.friction_knee = 2e-6;
  d.observer.drive = d.model;
  d.unit_per_count = quantum;
  return d;
}

/// Two masses in steps of 25 us, friction at the motor, under a P-PI cascade; speeds both ways.
/// `resonance_hz`: of the free pair; 0: one mass.
DriveData under_control(double resonance_hz, double quantum, unsigned seed) {
  DriveData d = axis(quantum);
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise;
  std::uniform_real_distribution<double> level(0.05, 1.0);
  constexpr int kSteps = 20;
  constexpr double kStep = kPeriod / kSteps;
  const bool two = resonance_hz > 0;
  const double motor = two ? (1 - kShare) * kMass : kMass, load = kShare * kMass;
  const double reduced = (1 - kShare) * kShare * kMass;
  const double w = kTurn * resonance_hz;
  const double stiffness = reduced * w * w, damping = reduced * 2 * 0.04 * w;
  const double bandwidth = kTurn * 20;
  double x = 0, v = 0, x_load = 0, v_load = 0, wanted_x = 0, wanted_v = 0, goal = 0;
  double integral = 0, filtered = 0, seen = 0, bristle = 0, force = 0;
  int sign = 1;
  for (int i = 0; i < static_cast<int>(7 / kPeriod); ++i) {
    if (i % 700 == 0) {  // another speed every 0.35 s
      goal = sign * 0.15 * level(random);
      sign = -sign;
    }
    const double most = 2.5 * kPeriod;
    wanted_v += std::min(most, std::max(-most, goal - wanted_v));
    wanted_x += wanted_v * kPeriod;
    const double measured = quantum * std::floor(x / quantum);
    DriveSample<double> sample;
    sample.increment = d.samples.empty() ? 0 : measured - d.samples.back().position;
    sample.position = measured;
    sample.turn_angle_rad = kTurn * (measured / 0.01 - std::floor(measured / 0.01));
    sample.effort = force + 0.5 * noise(random);
    d.samples.push_back(sample);
    filtered += 0.4 * ((measured - seen) / kPeriod - filtered);
    seen = measured;
    const double error = wanted_v + 0.2 * bandwidth * (wanted_x - measured) - filtered;
    integral += error * kPeriod * bandwidth / 6;
    force = kMass * bandwidth * (error + integral);
    for (int k = 0; k < kSteps; ++k) {
      // Dahl's bristle, advanced exactly.
      const double end = v > 0 ? 40 : -40;
      if (v != 0) bristle = end + (bristle - end) * std::exp(-std::abs(v) * kStep / 2e-6);
      const double passed = two ? stiffness * (x - x_load) + damping * (v - v_load) : 0;
      v += (force - bristle - 150 * v - passed) / motor * kStep;
      v_load += passed / load * kStep;
      x += v * kStep;
      x_load += v_load * kStep;
    }
  }
  return d;
}

void a_mode_beyond_the_band() {
  constexpr double kResonance = 85, kQuantum = 4e-7;
  const DriveData d = under_control(kResonance, kQuantum, 3);
  const double held = kResonance * std::sqrt(1 - kShare);
  check::figure("corner", comparison_corner(d), "Hz");
  check::figure("motor held, the load swings at", held, "Hz");
  CHECK(1.3 * comparison_corner(d) < held);
  const auto out = reconcile_drive(d, {});
  CHECK(out.has_value());
  if (!out) return;
  const Report& r = out->report;
  CHECK(r.effects.size() == 1);
  if (r.effects.size() != 1) return;
  const FoundEffect& e = r.effects[0];
  CHECK(e.name == "flexible-coupling");
  // A tenth: the encoder's noise is as large as the motion there.
  CHECK_NEAR(e.parameters[0].values[0] / kResonance, 1.0, 0.1);
  CHECK_NEAR(e.parameters[2].values[0] / kShare, 1.0, 0.15);
  // Nothing else is missing: the report is that of the band, and the gap shrinks in it.
  CHECK(e.gap_after < 0.5 * e.gap_before);
  CHECK(r.gap_before == e.gap_before && r.gap_after == e.gap_after);
  CHECK(r.summary.find("the gap shrinks from") != std::string::npos);
  CHECK(!r.proof.free_run.horizons.empty());
  for (const FreeRun::Horizon& h : r.proof.free_run.horizons) {
    check::figure("free run, before", 1e6 * h.position.before, "um");
    check::figure("free run, after", 1e6 * h.position.after, "um");
    check::figure("free run, noise alone", 1e6 * h.position.floor, "um");
  }
  CHECK(out->model.effects.find("flexible-coupling") != nullptr);
  CHECK(std::any_of(r.remarks.begin(), r.remarks.end(), [](const std::string& s) {
    return s.find("beyond the") != std::string::npos;
  }));
}

void no_mode() {
  const auto out = reconcile_drive(under_control(0, 4e-7, 4), {});
  CHECK(out.has_value());
  if (out) CHECK(out->report.effects.empty());
}

}  // namespace

int main() {
  a_mode_beyond_the_band();
  no_mode();
  return check::done();
}
