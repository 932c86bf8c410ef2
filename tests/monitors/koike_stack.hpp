// The machine of Koike 2016, tables 3-4 to 3-6, as a stack: the spindle reports counts, the axes
// counts, position and speed.
#pragma once

#include <array>

#include "servosense/core/units.hpp"
#include "servosense/monitors/monitor_stack.hpp"

namespace koike {

using namespace servosense;

struct Axis {
  double mass_kg, viscous, coulomb_N, gravity_N;
};
constexpr std::array<Axis, kAxes> kAxis = {
    {{227, 732, 94, 0}, {325, 1025, 151, 0}, {380, 1968, 240, 175 * kGravity_m_s2}}};
constexpr double kSpindleInertia_kg_m2 = 0.0048, kSpindleViscous = 4.775e-4,
                 kSpindleCoulomb_Nm = 0.1062;

inline MonitorStackConfig stack_config() {
  MonitorStackConfig c;
  c.spindle.present = true;
  c.spindle.input.unit_per_count = kTwoPi / (1 << 20);
  c.spindle.input.max_speed = 2000;
  c.spindle.observer.disturbance_cutoff_rad_s = c.spindle.observer.velocity_cutoff_rad_s = 3500;
  c.spindle.observer.drive.inertia = kSpindleInertia_kg_m2;
  c.spindle.observer.drive.viscous = kSpindleViscous;
  c.spindle.observer.drive.coulomb = kSpindleCoulomb_Nm;
  c.spindle.observer.drive.friction_knee = 1e-3;
  c.spindle.monitor_observer = c.spindle.observer;
  for (std::size_t i = 0; i < kAxes; ++i) {
    AxisSlotConfig& a = c.axis[i];
    a.present = true;
    a.input.kind = i == 0   ? MotionKind::counts
                   : i == 1 ? MotionKind::position
                            : MotionKind::velocity;
    a.input.unit_per_count = 0.016 / (1 << 20);
    a.input.unit_per_turn = 0.016;
    a.input.max_speed = 2;
    a.observer.disturbance_cutoff_rad_s = a.observer.velocity_cutoff_rad_s = 335;
    a.observer.drive.inertia = kAxis[i].mass_kg;
    a.observer.drive.viscous = kAxis[i].viscous;
    a.observer.drive.coulomb = kAxis[i].coulomb_N;
    a.observer.drive.constant_load = kAxis[i].gravity_N;
    a.observer.drive.friction_knee = 5e-6;
    a.observer.drive.unit_per_turn = 0.016;
    a.monitor_observer = a.observer;
  }
  return c;
}

}  // namespace koike
