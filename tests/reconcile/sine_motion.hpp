// A motion of three sines, with its derivatives in closed form, and what an axis records along it.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "servosense/reconcile/drive.hpp"

struct Motion {
  double position = 0, velocity = 0, acceleration = 0;
};

/// Sum of size (1 - cos w t).
inline Motion along_sines(const double (&hz)[3], const double (&size)[3], double t) {
  Motion m;
  for (int i = 0; i < 3; ++i) {
    const double w = 2 * std::numbers::pi * hz[i];
    m.position += size[i] * (1 - std::cos(w * t));
    m.velocity += size[i] * w * std::sin(w * t);
    m.acceleration += size[i] * w * w * std::cos(w * t);
  }
  return m;
}

/// 100 kg, 300 N s/m, and `force(t_s, position_m, direction)` with its friction, direction from -1
/// to 1 over 4 um; 18 s at 1 kHz, 0.4 N of noise. The file is some per cent off, with 62 N of
/// friction.
template <typename Force>
servosense::reconcile::DriveData sine_axis(Force force) {
  constexpr double kPeriod = 1e-3, kLength_s = 18;
  servosense::reconcile::DriveData d;
  d.sample_period_s = d.servo_period_s = kPeriod;
  d.model.inertia = 104;
  d.model.viscous = 290;
  d.model.coulomb = 62;
  d.model.unit_per_turn = 0.01;
  d.model.friction_knee = 2e-6;
  d.observer.drive = d.model;
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise;
  double direction = 0, last = 0;
  for (int i = 0; i * kPeriod < kLength_s; ++i) {
    const double t = i * kPeriod;
    const Motion x = along_sines({0.31, 0.83, 2.3}, {0.1, 0.03, 0.003}, t);
    direction = std::clamp(direction + (x.position - last) / 2e-6, -1.0, 1.0);
    servosense::DriveSample<double> sample;
    sample.increment = x.position - last;
    last = x.position;
    sample.effort = 100 * x.acceleration + 300 * x.velocity + force(t, x.position, direction) +
                    0.4 * noise(random);
    d.samples.push_back(sample);
  }
  return d;
}
