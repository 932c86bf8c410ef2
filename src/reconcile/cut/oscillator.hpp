// One structural mode, exact for a force that stays over the step.
#pragma once

#include <cmath>

#include "servosense/model/structural_mode.hpp"

namespace servosense::reconcile {

class Oscillator {
 public:
  Oscillator(const StructuralMode& mode, double step_s)
      : compliance_(1 / mode.stiffness_N_per_m()) {
    const double w = mode.natural_frequency_rad_s();
    const double decay = mode.damping_ratio * w;
    const double wd = w * std::sqrt(1 - mode.damping_ratio * mode.damping_ratio);
    const double e = std::exp(-decay * step_s);
    const double c = e * std::cos(wd * step_s), s = e * std::sin(wd * step_s);
    xx_ = c + decay / wd * s;
    xv_ = s / wd;
    vx_ = -w * w / wd * s;
    vv_ = c - decay / wd * s;
  }
  double step(double force_N) {
    const double rest = force_N * compliance_, d = x_ - rest;
    x_ = rest + xx_ * d + xv_ * v_;
    v_ = vx_ * d + vv_ * v_;
    return x_;
  }

 private:
  double compliance_, xx_, xv_, vx_, vv_;
  double x_ = 0, v_ = 0;
};

}  // namespace servosense::reconcile
