// A coarse encoder in a loop: the drive answers the quantum with torque, which looks like a
// relation between motion and torque. Nothing is missing in these records, and the floor has to say
// so.
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "../../src/reconcile/comparison_band.hpp"
#include "../../src/reconcile/drive_signals.hpp"
#include "check.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kTurn = 6.283185307179586;
constexpr double kPeriod = 5e-4;
constexpr double kInertia = 0.07;

DriveData spindle(double counts, bool counted) {
  DriveData d;
  d.channel = Channel::spindle;
  d.sample_period_s = d.servo_period_s = kPeriod;
  d.model.inertia = 1.05 * kInertia;
  d.model.viscous = 0.0018;
  d.model.coulomb = 0.42;
  d.model.unit_per_turn = kTurn;
  d.model.friction_knee = 1e-3;
  d.observer.drive = d.model;
  d.unit_per_count = counted ? kTurn / counts : 0;
  return d;
}

void append(DriveData& d, double measured, double& last, double torque) {
  DriveSample<double> sample;
  sample.increment = d.samples.empty() ? 0 : measured - last;
  sample.position = measured;
  sample.turn_angle_rad = measured - kTurn * std::floor(measured / kTurn);
  sample.effort = torque;
  d.samples.push_back(sample);
  last = measured;
}

/// Speeds up and down in both directions under a P-PI cascade, which sees the counted angle.
DriveData under_control(double counts, double bandwidth_hz, unsigned seed, bool counted) {
  DriveData d = spindle(counts, counted);
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise;
  std::uniform_real_distribution<double> level(0.2, 1.0);
  const double quantum = kTurn / counts, bandwidth = kTurn * bandwidth_hz;
  constexpr int kSteps = 20;  // of 25 us
  constexpr double kStep = kPeriod / kSteps;
  double x = 0, v = 0, wanted_x = 0, wanted_v = 0, goal = 0, integral = 0, filtered = 0;
  double seen = 0, bristle = 0, last = 0, torque = 0;
  int sign = 1;
  for (int i = 0; i < static_cast<int>(14 / kPeriod); ++i) {
    if (i % 1200 == 0) {  // another speed every 0.6 s
      goal = sign * 110 * level(random);
      sign = -sign;
    }
    const double most = 600 * kPeriod;
    wanted_v += std::min(most, std::max(-most, goal - wanted_v));
    wanted_x += wanted_v * kPeriod;
    const double measured = quantum * std::floor(x / quantum);
    append(d, measured, last, torque + 0.005 * noise(random));
    filtered += 0.6 * ((measured - seen) / kPeriod - filtered);
    seen = measured;
    const double error = wanted_v + 0.2 * bandwidth * (wanted_x - measured) - filtered;
    integral += error * kPeriod * bandwidth / 6;
    torque = kInertia * bandwidth * (error + integral);
    for (int k = 0; k < kSteps; ++k) {
      // Dahl's bristle, advanced exactly.
      const double end = v > 0 ? 0.4 : -0.4;
      if (v != 0) bristle = end + (bristle - end) * std::exp(-std::abs(v) * kStep / 5e-4);
      v += (torque - bristle - 0.0019 * v) / kInertia * kStep;
      x += v * kStep;
    }
  }
  return d;
}

/// The floor is what the error of the angle, a quantum's or a white noise's, does through a
/// Gaussian's second derivative, which is written here once more.
void quantum_through_the_filter() {
  constexpr double kCorner = 40;
  const double sigma = std::sqrt(std::log(2.0)) / kTurn / kCorner / kPeriod;  // samples
  for (const bool counted : {true, false}) {
    DriveData d = spindle(4096, counted);
    std::vector<double> error;
    std::mt19937_64 random(5);
    std::normal_distribution<double> noise;
    double last = 0;
    for (int i = 0; i < 20000; ++i) {
      const double t = i * kPeriod;
      const double x = 70 * t + 40 * std::sin(1.3 * t);
      const double measured =
          counted ? kTurn / 4096 * std::floor(x * 4096 / kTurn) : x + 3e-4 * noise(random);
      append(d, measured, last, 0);
      error.push_back(measured - x);
    }
    const int reach = static_cast<int>(5 * sigma);
    double square = 0;
    int n = 0;
    for (int i = reach; i + reach < static_cast<int>(error.size()); i += 7, ++n) {
      double a = 0;
      for (int k = -reach; k <= reach; ++k) {
        const double u = k / sigma;
        a += (u * u - 1) * std::exp(-0.5 * u * u) * error[static_cast<std::size_t>(i + k)];
      }
      a /= sigma * std::sqrt(kTurn) * sigma * kPeriod * sigma * kPeriod;
      square += a * a;
    }
    CHECK_NEAR(encoder_floor(d, kCorner) / (d.model.inertia * std::sqrt(square / n)), 1.0, 0.1);
  }
}

void nothing_is_missing() {
  const double counts[] = {4096, 4096, 8192};
  const double bandwidth_hz[] = {20, 35, 30};
  for (unsigned k = 0; k < 3; ++k) {
    const auto outcome =
        reconcile_drive(under_control(counts[k], bandwidth_hz[k], k + 1, k != 1), {});
    CHECK(outcome.has_value());
    if (!outcome) continue;
    CHECK(outcome->report.effects.empty());
    CHECK(outcome->report.verdict == Verdict::agrees);
    CHECK(outcome->report.floors.used >= outcome->report.floors.encoder);
  }
}

}  // namespace

int main() {
  quantum_through_the_filter();
  nothing_is_missing();
  return check::done();
}
