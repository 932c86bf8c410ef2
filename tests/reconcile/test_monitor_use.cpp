// Which effects the monitors get: those that make their observer read less on the part kept for the
// proof. An axis with backlash whose encoder is at the motor, and one whose motor ripples, from
// their equations of motion; what the monitors read is worked out here once more.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "oracles/idle_plant.hpp"
#include "servosense/core/units.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/observer/machine_config.hpp"
#include "servosense/reconcile/drive.hpp"

namespace {

using namespace servosense;

constexpr double kPeriod_s = 250e-6;
constexpr double kCount_m = 0.016 / (1 << 20);

/// Motor and stage with backlash between them, under a P-PI cascade at the motor.
struct Axis {
  double motor_kg = 60, stage_kg = 160, viscous = 700, coulomb_N = 60, stage_coulomb_N = 50;
  double backlash_m = 0, stiffness_N_m = 5e7, damping_N_s_m = 1e4;
  double ripple_N = 0;  // ten times a turn
  unsigned seed = 1;

  [[nodiscard]] std::vector<DriveSample<double>> run(double seconds) const {
    const oracle::FeedProgram program{{{.distance = 0.02, .speed = 0.05},
                                       {.distance = 0.1, .speed = 0.25},
                                       {.distance = 0.03, .speed = 0.12}}};
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    constexpr int kSteps = 50;
    constexpr double h = kPeriod_s / kSteps;
    const double whole_kg = motor_kg + stage_kg;
    oracle::Bristle motor_friction{5e-6}, stage_friction{5e-6};
    double x = 0, v = 0, stage_x = 0, stage_v = 0, sum = 0;
    std::int64_t last = 0;
    std::vector<DriveSample<double>> out;
    for (std::size_t i = 0; static_cast<double>(i) * kPeriod_s < seconds; ++i) {
      const oracle::Motion r = program.at(static_cast<double>(i) * kPeriod_s);
      const double error = 60 * (r.x - x) + r.v - v;
      sum += 300 * 30 * kPeriod_s * error;
      const double effort = whole_kg * (300 * error + sum) + viscous * r.v;
      DriveSample<double> s;
      const auto now = static_cast<std::int64_t>(std::floor(x / kCount_m));
      s.increment = static_cast<double>(now - last) * kCount_m;
      s.position = static_cast<double>(now) * kCount_m;
      s.turn_angle_rad = kTwoPi * (s.position / 0.016 - std::floor(s.position / 0.016));
      s.effort = effort + 3 * normal(random);
      last = now;
      out.push_back(s);
      for (int k = 0; k < kSteps; ++k) {
        const double apart = x - stage_x;
        const double pressed = apart - std::clamp(apart, -backlash_m / 2, backlash_m / 2);
        double link = 0;
        if (pressed != 0) link = stiffness_N_m * pressed + damping_N_s_m * (v - stage_v);
        if (link * pressed < 0) link = 0;  // it cannot pull
        const double acting = effort - ripple_N * std::sin(10 * kTwoPi * x / 0.016);
        const double motor_N =
            acting - link - viscous * v - coulomb_N * motor_friction.follow(h * v);
        const double stage_N = link - stage_coulomb_N * stage_friction.follow(h * stage_v);
        v += h * motor_N / motor_kg;
        stage_v += h * stage_N / stage_kg;
        x += h * v;
        stage_x += h * stage_v;
      }
    }
    return out;
  }
};

MachineFile file(const std::string& effect) {
  auto parsed = MachineFile::parse(
      "[machine]\nname = bed\n[axis.x]\nlead_m = 0.016\nequivalent_mass_kg = 220\n"
      "viscous_friction_N_s_per_m = 700\ncoulomb_friction_N = 110\nfriction_knee_m = 5e-6\n"
      "force_constant_N_per_A = 1\n" +
          effect,
      "bed.ini");
  CHECK(parsed);
  return *std::move(parsed);
}

reconcile::DriveData data_of(const Axis& axis, double seconds) {
  reconcile::DriveData d;
  d.sample_period_s = kPeriod_s;
  d.start_s = 100;
  d.samples = axis.run(seconds);
  return d;
}

/// Rms of what an observer of collisions reads in the last third, whatever the flag.
double reads(const MachineFile& machine, const reconcile::DriveData& d, bool with) {
  const auto axis = axis_config(machine, Channel::x);
  CHECK(axis);
  DisturbanceObserverConfig c = axis->disturbance_observer(kPeriod_s, {335, 335});
  if (!with) c.drive.effects.count = 0;
  DisturbanceObserver<double> observer;
  observer.configure(c);
  double square = 0, n = 0;
  for (std::size_t i = 0; i < d.samples.size(); ++i) {
    const double f = observer.process(d.samples[i]);
    if (3 * i < 2 * d.samples.size()) continue;
    square += f * f;
    ++n;
  }
  return std::sqrt(square / n);
}

reconcile::Report report_of(const reconcile::DriveData& d, const char* effect) {
  reconcile::Report r;
  r.channel = "x";
  const double length_s = static_cast<double>(d.samples.size()) * kPeriod_s;
  r.held_from_s = d.start_s + 2 * length_s / 3;
  r.held_to_s = d.start_s + length_s;
  r.effects.resize(1);
  r.effects[0].name = effect;
  return r;
}

bool said(const reconcile::Report& r, const char* what) {
  return std::any_of(r.remarks.begin(), r.remarks.end(),
                     [&](const std::string& s) { return s.find(what) != std::string::npos; });
}

void backlash_at_the_motor() {
  Axis axis;
  axis.backlash_m = 30e-6;
  const reconcile::DriveData d = data_of(axis, 9);
  const MachineFile given = file("");
  MachineFile with = file("[effect.x.backlash]\nwidth_m = 3e-05\n");
  const double before = reads(with, d, false), after = reads(with, d, true);
  check::figure("the monitors read without the backlash", before, "N");
  check::figure("the monitors read with it", after, "N");
  CHECK(after > before);  // or this drive shows nothing
  reconcile::Report r = report_of(d, "backlash");
  reconcile::choose_for_monitors(with, given, d, r);
  CHECK(!r.effects[0].used_by_monitors);
  CHECK(with.flag("effect.x.backlash", "used_by_monitors") == false);
  CHECK(said(r, "backlash stands in the machine file for simulation"));
  // Monitors do without, simulators and reconcile have it.
  CHECK(monitor_observer(with, Channel::x, EffortKind::force_N, kPeriod_s)->drive.effects.count ==
        0);
  CHECK(axis_config(with, Channel::x)->effects.count == 1);
  StackSignals signals;
  signals.sample_period_s = kPeriod_s;
  signals.axis[0] = DriveSignal{MotionKind::position, EffortKind::force_N};
  const auto plan = plan_stack(with, signals);
  CHECK(plan);
  CHECK(plan->config.axis[0].monitor_observer.drive.effects.count == 0);
  CHECK(plan->config.axis[0].observer.drive.effects.count == 0);
  CHECK(std::any_of(plan->remarks.begin(), plan->remarks.end(), [](const std::string& s) {
    return s.find("[effect.x.backlash]: kept from the monitors") != std::string::npos;
  }));
  // Nothing is lost: what they read is what they read before.
  CHECK(r.monitors_before.size() == 3 && r.monitors_before == r.monitors_after);
}

void ripple_of_the_motor() {
  Axis axis;
  axis.ripple_N = 30;
  axis.seed = 2;
  const reconcile::DriveData d = data_of(axis, 9);
  const MachineFile given = file("");
  MachineFile with = file(
      "[effect.x.torque-ripple]\norder = 10\namplitude_N = 30\nphase_rad = 0\n"
      "used_by_monitors = no\n");
  CHECK(reads(with, d, true) < 0.7 * reads(with, d, false));
  MachineFile used = with;
  used.set("effect.x.torque-ripple", "used_by_monitors", "yes");
  reconcile::Report r = report_of(d, "torque-ripple");
  reconcile::choose_for_monitors(used, given, d, r);
  CHECK(r.effects[0].used_by_monitors);
  CHECK(used.flag("effect.x.torque-ripple", "used_by_monitors") == true);
  CHECK(r.monitors_after[0].second < 0.7 * r.monitors_before[0].second);
  CHECK(r.remarks.empty());
}

}  // namespace

int main() {
  backlash_at_the_motor();
  ripple_of_the_motor();
  return check::done();
}
