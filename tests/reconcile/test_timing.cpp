// A delay between reported effort and force, on drives simulated here: named where what is reported
// has left the controller's computing time behind it, not where the same delay is all there is.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <random>

#include "check.hpp"
#include "drive_under_control.hpp"
#include "servosense/reconcile/drive.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kTurn = 6.283185307179586;
constexpr double kStep = 6.25e-5;  // s, of the integration
constexpr int kSteps = 4;          // per servo period
constexpr double kPeriod = kSteps * kStep;
constexpr int kThin = 4;  // servo periods per row

/// P-PI at 4 kHz, its speed behind a filter of 120 Hz, 100 kg, 300 N s/m and `coulomb_N`
/// along four sines; rows at 1 kHz, current noise of 0.3 N. The reported effort is
/// `reported_s` behind the controller's answer, the force another `behind_s`. The file tells a
/// current loop of 3 kHz.
DriveData record(double reported_s, double behind_s, double coulomb_N = 25, double length_s = 14,
                 double ripple_N = 0) {
  DriveData d;
  d.expected_lag_s = 5e-5;
  d.sample_period_s = d.servo_period_s = kThin * kPeriod;
  d.model.inertia = 105;
  d.model.viscous = 310;
  d.model.coulomb = 0.96 * coulomb_N;
  d.model.unit_per_turn = 0.01;
  d.model.friction_knee = 1e-6;
  d.observer.drive = d.model;
  std::mt19937_64 random(5);
  std::normal_distribution<double> noise;
  const double frequency[] = {0.23, 0.61, 1.7, 5.1};
  const double size[] = {0.05, 0.025, 0.004, 0.0015};
  const double gain = kTurn * 25, position_gain = gain / 5;
  const double filter = 1 - std::exp(-kTurn * 120 * kPeriod);
  const auto reported_late = static_cast<std::size_t>(std::lround(reported_s / kStep));
  const auto force_late = static_cast<std::size_t>(std::lround((reported_s + behind_s) / kStep));
  std::deque<double> answers(std::max(reported_late, force_late) + 1, 0.0);  // latest in front
  double x = 0, v = 0, bristle = 0, sum = 0, speed = 0, before = 0, last = 0, answer = 0;
  for (int k = 0; k < static_cast<int>(length_s / kPeriod); ++k) {
    const double t = k * kPeriod;
    double told = 0;
    for (int i = 0; i < 4; ++i) told += size[i] * (1 - std::cos(kTurn * frequency[i] * t));
    const double seen = 1e-8 * std::round(x / 1e-8);
    speed += filter * ((seen - before) / kPeriod - speed);
    before = seen;
    const double error = position_gain * (told - seen) - speed;
    sum += gain / 4 * kPeriod * error;
    answer = gain * 100 * (error + sum);
    if (k % kThin == 0) {
      DriveSample<double> sample;
      sample.increment = d.samples.empty() ? 0 : seen - last;
      const double reported = reported_late > 0 ? answers[reported_late - 1] : answer;
      sample.effort = reported + 0.3 * noise(random);
      d.samples.push_back(sample);
      d.command.push_back(told);
      last = seen;
    }
    for (int i = 0; i < kSteps; ++i) {
      answers.push_front(answer);
      answers.pop_back();
      // Dahl's friction over 1 um, advanced as exactly as the rest.
      bristle += v * kStep / 1e-6 * (1 - bristle * (v > 0 ? 1 : -1));
      bristle = std::clamp(bristle, -1.0, 1.0);
      v += kStep / 100 *
           (answers[force_late] - 300 * v - coulomb_N * bristle -
            ripple_N * std::sin(7 * kTurn * x / 0.01));
      x += kStep * v;
    }
  }
  return d;
}

void the_same_delay_before_and_behind() {
  constexpr double kBehind = 13 * kStep;  // and half a servo period, for which the answer is held
  // A reference is reported: what comes after it is computing, current loop and hold.
  const auto reference = reconcile_drive(record(0, kBehind), {});
  CHECK(reference.has_value());
  if (reference) {
    CHECK(reference->report.effects.empty());
    CHECK_NEAR(reference->report.timing_s, kBehind + kPeriod / 2, 5e-5);
  }
  // A measured current that is 0.5 ms behind the answer: nothing of that explains the same delay.
  const auto measured = reconcile_drive(record(0.5e-3, kBehind), {});
  CHECK(measured.has_value());
  if (!measured) return;
  CHECK(measured->report.effects.size() == 1);
  for (const FoundEffect& e : measured->report.effects) {
    CHECK(e.name == "transport-delay" || e.name == "current-loop-lag");
    CHECK_NEAR(measured->report.timing_s, kBehind + kPeriod / 2, 5e-5);
  }
  // Nor is anything named where the measured current and the force are one.
  const auto healthy = reconcile_drive(record(0.5e-3, 0), {});
  CHECK(healthy.has_value());
  if (healthy) CHECK(healthy->report.effects.empty());
}

/// Fitted beside the wrong timing, the presliding distance of a large friction comes out at its
/// shortest, and a bristle then stands for what it really is. Dahl's friction over 1 um is no
/// presliding.
void no_bristle_beside_a_delay() {
  const auto outcome = reconcile_drive(record(0, 40 * kStep, 140, 8), {});
  CHECK(outcome.has_value());
  if (!outcome) return;
  for (const FoundEffect& e : outcome->report.effects) std::printf("late: %s\n", e.name.c_str());
  CHECK(outcome->report.effects.size() == 1);
  for (const FoundEffect& e : outcome->report.effects) CHECK(e.name == "transport-delay");
}

/// The file tells a current loop of 400 Hz. It explains 0.5 ms behind a reference, not behind a
/// current that is itself later than computing makes it.
void the_loop_has_passed_already() {
  for (const bool passed : {false, true}) {
    DriveData data = record(passed ? 0.75e-3 : 0, 8 * kStep);
    data.servo_period_s = kPeriod;
    data.expected_lag_s = 4e-4;
    const auto outcome = reconcile_drive(data, {});
    CHECK(outcome.has_value());
    if (!outcome) continue;
    CHECK(outcome->report.effects.size() == (passed ? 1 : 0));
    for (const FoundEffect& e : outcome->report.effects) {
      std::printf("behind the loop: %s\n", e.name.c_str());
      CHECK(e.name == "transport-delay" || e.name == "current-loop-lag");
      CHECK_NEAR(outcome->report.timing_s, 8 * kStep + kPeriod / 2, 5e-5);
    }
  }
}

/// Of a current loop that the file does not tell, 300 Hz are no news.
void nothing_told() {
  for (const double behind : {7 * kStep, 13 * kStep}) {
    DriveData data = record(0.5e-3, behind);
    data.expected_lag_s = 0;
    const auto outcome = reconcile_drive(data, {});
    CHECK(outcome.has_value());
    if (outcome) CHECK(outcome->report.effects.empty());
  }
  DriveData data = record(0.5e-3, 40 * kStep);
  data.expected_lag_s = 0;
  const auto outcome = reconcile_drive(data, {});
  CHECK(outcome.has_value());
  if (outcome) CHECK(outcome->report.effects.size() == 1);
}

/// What the loop answers to ripple looks late beside a model without ripple: the force is 0.25 ms
/// behind, usual even where the file tells the current loop.
void not_late_beside_ripple() {
  const auto outcome = reconcile_drive(record(0.25e-3, 2 * kStep, 25, 14, 8), {});
  CHECK(outcome.has_value());
  if (!outcome) return;
  CHECK(outcome->report.effects.size() == 1);
  for (const FoundEffect& e : outcome->report.effects) {
    std::printf("beside ripple: %s\n", e.name.c_str());
    CHECK(e.name == "torque-ripple");
  }
}

/// What shakes a drive moves it first, and the loop answers later: no delay, for that is as long
/// for slow motion as for fast. A drive without any, but for half a servo period.
void not_late_for_being_shaken() {
  DriveUnderControl axis = axis_under_control();
  axis.quantum = 1e-8;
  axis.noise = 1;
  axis.length_s = 10;
  axis.change_s = 1;
  axis.acceleration = 0.7;
  axis.push = 40;
  for (const double hz : {15.0, 25.0, 35.0}) {
    axis.push_hz = hz;
    const auto outcome = reconcile_drive(record_of(axis, 1e-3), {});
    CHECK(outcome.has_value());
    if (!outcome) continue;
    CHECK(outcome->report.effects.empty());
    CHECK_TEXT(name_of(outcome->report.verdict), "unexplained");
  }
}

/// A current that is read behind the motion: named, with nothing beside it, and not in the model,
/// which cannot look ahead.
void read_behind_the_motion() {
  const auto outcome = reconcile_drive(record(32 * kStep, -32 * kStep), {});
  CHECK(outcome.has_value());
  if (!outcome) return;
  CHECK(outcome->report.effects.size() == 1);
  for (const FoundEffect& e : outcome->report.effects) {
    CHECK_TEXT(e.name, "transport-delay");
    // Half a servo period, for which the answer is held, has passed the other way.
    CHECK_NEAR(e.parameters.at(0).values.at(0), 32 * kStep - kPeriod / 2, 5e-5);
    CHECK(e.gap_after < 0.2 * e.gap_before);
  }
  CHECK(outcome->model.effects.count == 0);
  CHECK(outcome->report.remarks.size() == 1);
}

}  // namespace

int main(int argc, char** argv) {
  nothing_told();
  not_late_beside_ripple();
  read_behind_the_motion();
  the_loop_has_passed_already();
  if (check::nightly(argc, argv)) {
    not_late_for_being_shaken();
    the_same_delay_before_and_behind();
    no_bristle_beside_a_delay();
  }
  return check::done();
}
