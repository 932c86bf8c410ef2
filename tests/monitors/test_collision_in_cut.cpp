// Collision while the tool cuts: the cut detector against its closed form, and what the monitor
// makes of forces that a cut, a first contact and a collision would give.
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "check.hpp"
#include "servosense/monitors/collision.hpp"
#include "servosense/monitors/cut_detector.hpp"

namespace {

using namespace servosense;
constexpr double kPeriod_s = 125e-6;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kTurning_rad = 500 * kPeriod_s;  // in a sample

// ---- the detector ------------------------------------------------------------------------------

CutDetectorConfig detector_config() {
  CutDetectorConfig c;
  c.torque_Nm = 0.5;
  return c;
}

// A step of torque passes the level after ln(T / (T - level)) / a, and falls below it again after
// ln(reached / level) / a, whence the hold counts.
template <typename Real>
void step_of_torque() {
  CHECK(CutDetector<Real>::validate(detector_config()).ok());
  CutDetector<Real> detector;
  detector.configure(detector_config());
  const auto run = [&](double torque_Nm, int samples, CutPresence until) {
    for (int n = 0; n < samples; ++n)
      if (detector.process(static_cast<Real>(torque_Nm), static_cast<Real>(kTurning_rad),
                           Quality::good) == until)
        return n + 1;
    return -1;
  };
  CHECK(run(0, 4000, CutPresence::cutting) == -1);
  CHECK(detector.state().cut == CutPresence::possible);
  for (const double torque : {0.6, 2.0, -20.0}) {
    const double size = std::abs(torque);
    const double expected = std::log(size / (size - 0.5)) / 25 / kPeriod_s;
    // Euler against the exponential: a T = 0.3 %.
    CHECK_NEAR(run(torque, 20000, CutPresence::cutting), expected, 2 + 0.005 * expected);
    (void)run(torque, 20000, CutPresence::air);
    const double falling = std::log(size / 0.5) / 25 / kPeriod_s;
    CHECK_NEAR(run(0, 40000, CutPresence::possible), falling + 240, 3 + 0.005 * falling);
    (void)run(0, 20000, CutPresence::cutting);
  }
}

void spindle_and_faults() {
  CutDetector<double> detector;
  detector.configure(detector_config());
  CHECK(detector.process(0, 0, Quality::good) == CutPresence::air);
  for (int n = 0; n < 2000; ++n) detector.process(0, -kTurning_rad, Quality::good);
  CHECK(detector.state().cut == CutPresence::possible);  // either way round
  for (int n = 0; n < 2000; ++n) detector.process(5, -kTurning_rad, Quality::good);
  CHECK(detector.state().cut == CutPresence::cutting);
  // What cannot be trusted changes nothing.
  for (int n = 0; n < 4000; ++n) {
    CHECK(detector.process(kNan, kTurning_rad, Quality::good) == CutPresence::cutting);
    CHECK(detector.process(0, kNan, Quality::good) == CutPresence::cutting);
    CHECK(detector.process(1e3, 0, Quality::missing) == CutPresence::cutting);
  }
  CHECK(std::abs(detector.state().torque_Nm - 5) < 0.02);
  // In a gap it may do anything.
  CHECK(detector.process(5, kTurning_rad, Quality::gap) == CutPresence::cutting);
  for (int n = 0; n < 8000; ++n) detector.process(0, 0, Quality::good);
  CHECK(detector.state().cut == CutPresence::air);
  // Without a level it may cut whenever the spindle turns; without a spindle at any time.
  detector.configure({});
  CHECK(detector.process(100, 0, Quality::good) == CutPresence::air);
  for (int n = 0; n < 2000; ++n) detector.process(0, kTurning_rad, Quality::good);
  CHECK(detector.state().cut == CutPresence::cutting);
  for (int n = 0; n < 8000; ++n) detector.process(100, 0, Quality::good);
  CHECK(detector.state().cut == CutPresence::air);
  CutDetectorConfig unseen;
  unseen.unseen = true;
  detector.configure(unseen);
  CHECK(detector.state().cut == CutPresence::cutting);
  CutDetectorConfig bad = detector_config();
  bad.cutoff_rad_s = 1000;
  CHECK(!CutDetector<double>::validate(bad).ok());
  bad = detector_config();
  bad.torque_Nm = kNan;
  CHECK(!CutDetector<double>::validate(bad).ok());
}

// ---- the monitor -------------------------------------------------------------------------------

constexpr double kAir_N_per_s = 2e3, kCut_N_per_s = 30e3;
constexpr int kWait = 240;

CollisionConfig config() {
  CollisionConfig c;
  c.threshold_N_per_s = kAir_N_per_s;
  c.cutting_threshold_N_per_s = kCut_N_per_s;
  return c;
}

template <typename Real>
struct Axis {
  CollisionMonitor<Real> monitor;
  double force_N = 0;
  int sample = 0;

  explicit Axis(const CollisionConfig& c = config()) {
    CHECK(CollisionMonitor<Real>::validate(c).ok());
    monitor.configure(c);
    run(600, 0, CutPresence::possible);
    CHECK(monitor.state().state == MonitorState::armed);
    sample = 0;
  }
  MonitorState step(double rate_N_per_s, CutPresence cut, double speed_m_s = 0.02,
                    Quality quality = Quality::good) {
    ++sample;
    force_N += rate_N_per_s * kPeriod_s;
    return monitor.process(static_cast<Real>(force_N), static_cast<Real>(speed_m_s * kPeriod_s),
                           quality, cut);
  }
  // Sample of the alarm, or -1.
  int run(int samples, double rate_N_per_s, CutPresence cut, double speed_m_s = 0.02) {
    int alarm = -1;
    for (int n = 0; n < samples; ++n)
      if (step(rate_N_per_s, cut, speed_m_s) == MonitorState::alarm && alarm < 0) alarm = sample;
    return alarm;
  }
};

// Samples until a steady rate has been over the threshold for three.
int third_over(double rate_N_per_s, double threshold_N_per_s) {
  DisturbanceJerk<double> jerk;
  jerk.configure({});
  double force = 0;
  for (int n = 0; n < 1000; ++n) jerk.process(force);
  for (int n = 1, over = 0; n < 10000; ++n) {
    force += rate_N_per_s * kPeriod_s;
    over = std::abs(jerk.process(force)) >= threshold_N_per_s ? over + 1 : 0;
    if (over == 3) return n;
  }
  return -1;
}

template <typename Real>
void thresholds_in_the_cut() {
  // In the cut the threshold of the cut, at once.
  Axis<Real> cutting;
  CHECK(cutting.run(4000, 25e3, CutPresence::cutting) == -1);
  CHECK_NEAR(static_cast<double>(cutting.monitor.threshold_N_per_s()), kCut_N_per_s, 1e-2);
  Axis<Real> hit;
  CHECK(hit.run(400, 60e3, CutPresence::cutting) == third_over(60e3, kCut_N_per_s));
  // In the air that of the air.
  Axis<Real> air;
  CHECK(air.run(400, 25e3, CutPresence::air) == third_over(25e3, kAir_N_per_s));
  CHECK_NEAR(static_cast<double>(air.monitor.threshold_N_per_s()), kAir_N_per_s, 1e-3);
  // A rapid is never a cut.
  Axis<Real> rapid;
  CHECK(rapid.run(600, 0, CutPresence::possible, 0.4) == -1);
  rapid.sample = 0;
  CHECK(rapid.run(400, 25e3, CutPresence::possible, 0.4) == third_over(25e3, kAir_N_per_s));
  // Where the threshold of the cut lies below that of the air, that of the air holds.
  CollisionConfig low = config();
  low.cutting_threshold_N_per_s = 1e3;
  Axis<Real> quiet(low);
  CHECK(quiet.run(2000, 1.9e3, CutPresence::cutting) == -1);
}

template <typename Real>
void first_contacts() {
  const int over = third_over(25e3, kAir_N_per_s);
  // No torque comes: a collision, when the wait is over. Also one that has ended meanwhile.
  for (const int lasts : {60, 4000}) {
    Axis<Real> axis;
    int alarm = axis.run(lasts, 25e3, CutPresence::possible);
    if (alarm < 0) alarm = axis.run(2000, 0, CutPresence::possible);
    CHECK(alarm == over + kWait + 2);
    CHECK(axis.monitor.state().alarms == 1);
  }
  // More than any cut: at once.
  Axis<Real> hard;
  CHECK(hard.run(400, 60e3, CutPresence::possible) == third_over(60e3, kCut_N_per_s));
  // Torque comes in time: a cut; it may come and go.
  Axis<Real> cut;
  CHECK(cut.run(over + kWait - 1, 25e3, CutPresence::possible) == -1);
  CHECK(cut.run(100, 25e3, CutPresence::cutting) == -1);
  CHECK(cut.run(kWait, 25e3, CutPresence::possible) == -1);
  CHECK(cut.run(100, 0, CutPresence::cutting) == -1);
  CHECK(cut.run(2000, 0, CutPresence::possible) == -1);
  // The spindle stops before: no cut can follow.
  Axis<Real> stopped;
  CHECK(stopped.run(60, 25e3, CutPresence::possible) == -1);
  CHECK(stopped.run(2000, 0, CutPresence::air) == 60 + 3);
  // A fault takes the suspicion with it.
  Axis<Real> lost;
  CHECK(lost.run(100, 25e3, CutPresence::possible) == -1);
  CHECK(lost.step(0, CutPresence::possible, 0.02, Quality::missing) != MonitorState::alarm);
  CHECK(lost.monitor.state().faults == 1);
  lost.monitor.reset();
  CHECK(lost.run(2000, 0, CutPresence::possible) == -1);
  // What it reports is what it saw.
  Axis<Real> told;
  while (told.sample < 1000 &&
         told.step(25e3 * (told.sample < 400), CutPresence::possible) != MonitorState::alarm) {
  }
  CHECK_NEAR(static_cast<double>(told.monitor.threshold_N_per_s()), kAir_N_per_s, 1e-3);
  CHECK_BETWEEN(static_cast<double>(told.monitor.alarm().state().value), 20e3, 30e3);
}

// Two samples over the threshold of the air start nothing.
void two_are_too_few() {
  for (double size = 1; size < 60; size += 0.25) {
    DisturbanceJerk<double> jerk;
    jerk.configure({});
    for (int n = 0; n < 500; ++n) jerk.process(0);
    int over = 0, longest = 0;
    for (int n = 0; n < 300; ++n) {
      over = std::abs(jerk.process(size)) >= kAir_N_per_s ? over + 1 : 0;
      longest = std::max(longest, over);
    }
    Axis<double> axis;
    axis.force_N = size;
    CHECK((axis.run(1200, 0, CutPresence::possible) >= 0) == (longest >= 3));
  }
}

// Nothing is known of the cut: there it is unarmed, and says so. Elsewhere it is as ever.
template <typename Real>
void not_taught() {
  CollisionConfig plain = config();
  plain.cutting_threshold_N_per_s = 0;
  Axis<Real> cutting(plain);
  CHECK(cutting.run(4000, 600e3, CutPresence::cutting) == -1);
  CHECK(cutting.monitor.threshold_N_per_s() == 0 && cutting.monitor.alarm().state().value == 0);
  CHECK(cutting.monitor.state().state == MonitorState::armed);
  // A rapid, and a standing spindle.
  Axis<Real> rapid(plain);
  CHECK(rapid.run(600, 0, CutPresence::cutting, 0.4) == -1);
  rapid.sample = 0;
  CHECK(rapid.run(400, 25e3, CutPresence::cutting, 0.4) == third_over(25e3, kAir_N_per_s));
  Axis<Real> standing(plain);
  CHECK(standing.run(400, 25e3, CutPresence::air) == third_over(25e3, kAir_N_per_s));
  // With the spindle turning, what brings no torque is no cut, however hard it is.
  for (const double rate : {25e3, 600e3}) {
    Axis<Real> air(plain);
    CHECK(air.run(2000, rate, CutPresence::possible) == third_over(rate, kAir_N_per_s) + kWait + 2);
    Axis<Real> cut(plain);
    CHECK(cut.run(200, rate, CutPresence::possible) == -1);
    CHECK(cut.run(200, rate, CutPresence::cutting) == -1);
    CHECK(cut.run(kWait, 0, CutPresence::cutting) == -1);  // as the detector holds it
    CHECK(cut.run(8000, 0, CutPresence::possible) == -1);
  }
}

// An alarm that had waited is raised again from its evidence, bit for bit.
template <typename Real>
void replayed() {
  Axis<Real> axis;
  int n = 0;
  while (n < 2000 && axis.step(25e3 * (n < 50), CutPresence::possible) != MonitorState::alarm) ++n;
  CHECK(axis.monitor.state().alarms == 1);
  const auto evidence = axis.monitor.evidence();
  CHECK(evidence.count > CollisionMonitor<Real>::kEvidenceStride);
  const auto core = axis.monitor.replay(evidence);
  CHECK(core.alarm.state().state == MonitorState::alarm);
  CHECK(core.state.jerk_N_per_s == axis.monitor.state().jerk_N_per_s);
  CHECK(core.state.alarms == 1);
}

void refusals() {
  CollisionConfig c = config();
  c.cutting_threshold_N_per_s = -1;
  CHECK_TEXT(CollisionMonitor<double>::validate(c).parameter(), "cutting_threshold_N_per_s");
  c = config();
  c.maximum_feed_m_s = 0;
  CHECK_TEXT(CollisionMonitor<double>::validate(c).parameter(), "maximum_feed_m_s");
  c = config();
  c.wait_s = kNan;
  CHECK_TEXT(CollisionMonitor<double>::validate(c).parameter(), "wait_s");
}

}  // namespace

int main() {
  step_of_torque<float>();
  step_of_torque<double>();
  spindle_and_faults();
  thresholds_in_the_cut<float>();
  thresholds_in_the_cut<double>();
  first_contacts<float>();
  first_contacts<double>();
  two_are_too_few();
  not_taught<float>();
  not_taught<double>();
  replayed<float>();
  replayed<double>();
  refusals();
  return check::done();
}
