// A coarse encoder in a loop: the drive answers the quantum with torque, which looks like a
// relation between motion and torque. Nothing is missing in these records, and the floor has to say
// so.
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "check.hpp"
#include "drive_under_control.hpp"
#include "reconcile/drive/comparison_band.hpp"
#include "reconcile/drive/signals.hpp"
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

DriveData under_control(double counts, double bandwidth_hz, unsigned seed, bool counted) {
  DriveData d = spindle(counts, counted);
  const DriveUnderControl drive{.inertia = kInertia,
                                .viscous = 0.0019,
                                .coulomb = 0.4,
                                .bristle = 5e-4,
                                .quantum = kTurn / counts,
                                .bandwidth_hz = bandwidth_hz,
                                .filter = 0.6,
                                .top_speed = 110,
                                .least_level = 0.2,
                                .acceleration = 600,
                                .change_s = 0.6,
                                .length_s = 14,
                                .noise = 0.005,
                                .seed = seed};
  drive.record(d);
  return d;
}

/// The floor is what the error of the angle, a quantum's or a white noise's, does through a
/// Gaussian's second derivative, which is written here once more.
void quantum_through_the_filter() {
  constexpr double kCorner = 40;
  const double sigma = std::sqrt(std::log(2.0)) / kTurn / kCorner / kPeriod;  // samples
  enum class Motion { counts, noisy_counts, steps, smooth };  // steps: a speed, for example
  for (const Motion motion :
       {Motion::counts, Motion::noisy_counts, Motion::steps, Motion::smooth}) {
    const double counts = motion == Motion::noisy_counts ? 1 << 20 : 4096;
    const double sigma_x = motion == Motion::noisy_counts || motion == Motion::smooth ? 3e-4 : 0;
    DriveData d = spindle(counts, motion == Motion::counts || motion == Motion::noisy_counts);
    if (motion == Motion::steps) d.motion_step = kTurn / 4096;
    std::vector<double> error;
    std::mt19937_64 random(5);
    std::normal_distribution<double> noise;
    double last = 0;
    for (int i = 0; i < 20000; ++i) {
      const double t = i * kPeriod;
      const double x = 70 * t + 40 * std::sin(1.3 * t);
      const double seen = x + sigma_x * noise(random);
      const double measured =
          motion == Motion::smooth ? seen : kTurn / counts * std::floor(seen * counts / kTurn);
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
