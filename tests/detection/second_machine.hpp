// A machine of the second generator of cuts, and what its user learns from an idling run. It shares
// nothing with random_cuts.hpp and sim/ but the noise.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "detection/learned_machine.hpp"
#include "servosense/core/servo_sample.hpp"
#include "servosense/identify/learn_thresholds.hpp"
#include "servosense/io/machine_file.hpp"
#include "servosense/monitors/stack_config.hpp"
#include "servosense/sim/gaussian_noise.hpp"

namespace detection::second {

using namespace servosense;

inline constexpr double kPeriod_s = 125e-6;

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : noise_(seed * 0x9e3779b97f4a7c15U + 77) {}
  double between(double low, double high) { return low + (high - low) * noise_.uniform(); }
  double scale(double low, double high) { return low * std::pow(high / low, noise_.uniform()); }
  int whole(int low, int high) {
    return std::min(high, low + int(noise_.uniform() * (high - low + 1)));
  }
  bool chance(double p) { return noise_.uniform() < p; }

 private:
  GaussianNoise noise_;
};

/// Motor, load and cascade; rad and Nm, or m and N. With a belt between them the controller listens
/// to the motor, the encoder that is reported is that of the load.
struct Drive {
  double inertia = 0, viscous = 0, coulomb = 0, knee = 0;
  double loop_rad_s = 0, position_per_s = 0;  // 0: a speed is commanded
  double per_ampere = 0, noise_A = 0, resolution_A = 0, unit_per_turn = 0;
  int bits = 20, hold = 1;
  double belt_rad_s = 0, belt_damping = 0, load_share = 1;  // resonance; 0: no belt

  double x = 0, v = 0, integral = 0, effort = 0, last_command = 0, heard_A = 0;
  double motor_x = 0, motor_v = 0;

  void control(double command) {
    double wanted = command;
    const double turns = belt_rad_s > 0 ? motor_v : v;
    if (position_per_s > 0) {
      wanted = position_per_s * (command - x) + (command - last_command) / kPeriod_s;
      last_command = command;
    }
    integral += (wanted - turns) * loop_rad_s / 6 * kPeriod_s;
    effort = inertia * loop_rad_s * (wanted - turns + integral) + viscous * turns;
  }
  void advance(double load, double step_s) {
    const double slip = v / knee;
    const double friction = coulomb * (1 + 0.3 * std::exp(-slip * slip / 400)) * std::tanh(slip);
    double drives = effort;
    if (belt_rad_s > 0) {
      const double w = belt_rad_s;
      drives = inertia * load_share * (1 - load_share) *
               (w * w * (motor_x - x) + 2 * belt_damping * w * (motor_v - v));
      motor_v += step_s * (effort - drives) / (inertia * (1 - load_share));
      motor_x += step_s * motor_v;
    }
    v += step_s * (drives - load - viscous * v - friction) /
         (belt_rad_s > 0 ? inertia * load_share : inertia);
    x += step_s * v;
  }
  RawDriveSample<double> report(int n, GaussianNoise& noise) {
    RawDriveSample<double> raw;
    raw.counts =
        static_cast<std::int64_t>(std::floor(x / unit_per_turn * std::ldexp(1, bits))) & 0xffffffff;
    if (n % hold == 0)
      heard_A =
          resolution_A * std::round((effort / per_ampere + noise_A * noise.next()) / resolution_A);
    else
      raw.effort_quality = Quality::held;
    raw.effort = heard_A;
    return raw;
  }
};

/// Spindle, x and y; parameters in the machine file over the true ones.
struct Machine {
  std::array<Drive, 3> drive;
  std::array<double, 3> told{};
};

inline Machine draw_machine(Draw& d, double rated_Nm) {
  Machine m;
  Drive& s = m.drive[0];
  s.inertia = rated_Nm * d.between(1.5e-4, 4e-4);
  s.viscous = rated_Nm * d.between(1e-5, 6e-5);
  s.coulomb = rated_Nm * d.between(0.003, 0.015);
  s.knee = 0.5;
  s.loop_rad_s = kTwoPi * d.between(10, 60);
  s.per_ampere = rated_Nm / 20;
  s.unit_per_turn = kTwoPi;
  for (std::size_t i = 1; i < 3; ++i) {
    Drive& a = m.drive[i];
    a.inertia = d.scale(80, 500);
    a.viscous = a.inertia * d.between(1, 6);
    a.coulomb = a.inertia * d.between(0.2, 1);
    a.knee = 3e-4;
    a.loop_rad_s = kTwoPi * d.between(25, 60);
    a.position_per_s = a.loop_rad_s / 5;
    a.per_ampere = 250;
    a.unit_per_turn = 0.016;
  }
  for (Drive& one : m.drive) {
    one.bits = d.whole(17, 23);
    one.hold = 1 << d.whole(0, 3);
    one.noise_A = d.between(0.005, 0.05);
    one.resolution_A = 80.0 / (1 << d.whole(12, 16));
  }
  for (double& t : m.told) t = d.between(0.97, 1.03);
  return m;
}

using Samples = std::vector<ServoSample<double>>;

[[nodiscard]] inline StackPlan plan_for(const MachineFile& machine) {
  StackSignals signals;
  signals.spindle = signals.axis[0] = signals.axis[1] =
      DriveSignal{MotionKind::counts, EffortKind::current_A};
  return *plan_stack(machine, signals);
}

/// The machine's file with what its idling run teaches; chatter and breakage only where the teeth
/// are told.
[[nodiscard]] inline MachineFile learned(const Machine& m, const Samples& idle,
                                         unsigned teeth = 0) {
  auto parsed = MachineFile::parse("[machine]\nname = drawn\n", "drawn.ini");
  MachineFile f = *std::move(parsed);
  const char* sections[] = {"spindle", "axis.x", "axis.y"};
  for (std::size_t i = 0; i < 3; ++i) {
    const Drive& d = m.drive[i];
    const std::string name = sections[i];
    const bool turns = i == 0;
    f.set(name, turns ? "inertia_kg_m2" : "equivalent_mass_kg", m.told[i] * d.inertia);
    f.set(name, turns ? "viscous_friction_Nm_s_per_rad" : "viscous_friction_N_s_per_m",
          m.told[(i + 1) % 3] * d.viscous);
    f.set(name, turns ? "coulomb_friction_Nm" : "coulomb_friction_N",
          m.told[(i + 2) % 3] * d.coulomb);
    f.set(name, turns ? "torque_constant_Nm_per_A" : "force_constant_N_per_A", d.per_ampere);
    f.set(name, "encoder_counts_per_rev", std::ldexp(1.0, d.bits));
    f.set(name, "counter_bits", 32);
    f.set(name, "current_update_hz", 8000.0 / d.hold);
    if (!turns) f.set(name, "lead_m", d.unit_per_turn);
    if (!turns) f.set(name, "friction_knee_m", 3e-7);  // speed decides here, not travel
  }
  if (teeth > 0) f.set("tool", "teeth", teeth);
  const StackPlan plan = plan_for(f);
  for (std::size_t i = 0; i < 3; ++i) {
    DriveInput<double> input;
    input.configure(i == 0 ? plan.config.spindle.input : plan.config.axis[i - 1].input);
    DriveRecord record;
    record.sample_period_s = kPeriod_s;
    for (const auto& s : idle)
      record.samples.push_back(input.process(i == 0 ? s.spindle : s.axis[i - 1]));
    if (i == 0) {
      const auto& observer = plan.config.spindle.monitor_observer;
      f.set("monitor.collision", "cutting_torque_Nm",
            learn_cutting_torque(observer, plan.config.cut, record));
      if (teeth == 0) continue;
      f.set("monitor.chatter", "chatter_threshold_Nm2",
            learn_chatter(observer, plan.config.spindle.chatter, record).threshold());
      const ToothNoise noise = learn_tooth_noise(observer, teeth, record);
      f.set("monitor.ar-breakage", "noise_Nm", noise.tooth.sigma());
      f.set("monitor.tooth-breakage", "noise_Nm", noise.tooth.sigma());
      f.set("monitor.tooth-breakage", "sample_noise_Nm", noise.sample.sigma());
      continue;
    }
    const std::string name = i == 1 ? "x" : "y";
    const HostAxisSlotConfig& axis = plan.config.axis[i - 1];
    const auto jerk = learn_collision(axis.monitor_observer, axis.collision, record);
    set_collision_thresholds(f, name, jerk);
  }
  return f;
}

}  // namespace detection::second
