// The motion of an axis as its counter shows it, and nothing else: for columns driven by it.
#pragma once

#include <cmath>

#include "servosense/reconcile/drive.hpp"

/// 100 kg with 80 N of Coulomb friction (presliding distance 1 um) at `position(t)`, for so long;
/// steps of `count_m`.
template <typename Position>
servosense::reconcile::DriveData counted_motion(Position position, double length_s, double period_s,
                                                double count_m) {
  servosense::reconcile::DriveData data;
  data.sample_period_s = data.servo_period_s = period_s;
  data.unit_per_count = count_m;
  data.model.inertia = 100;
  data.model.coulomb = 80;
  data.model.friction_knee = 1e-6;
  double before = 0;
  for (int i = 0; i * period_s < length_s; ++i) {
    servosense::DriveSample<double> s{};
    const double x = count_m * std::floor(position(i * period_s) / count_m + 0.5);
    s.increment = x - before;
    before = x;
    data.samples.push_back(s);
  }
  return data;
}
