// How the blocks of the golden files are configured.
#pragma once

#include "servosense/core/units.hpp"
#include "servosense/dsp/angle_sampler.hpp"
#include "servosense/dsp/biquad.hpp"
#include "servosense/dsp/first_order.hpp"
#include "servosense/dsp/lattice_ar.hpp"
#include "servosense/dsp/moving_threshold.hpp"
#include "servosense/dsp/notch.hpp"
#include "servosense/dsp/rotational_filter.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace golden {

using namespace servosense;

inline constexpr double kPeriod_s = 125e-6;
inline constexpr FirstOrderConfig kTustin{500, kPeriod_s, Discretisation::tustin};
inline constexpr FirstOrderConfig kEuler{4000, kPeriod_s, Discretisation::backward_euler};
/// Poles 0.9 exp(+-0.5 j), in float and double alike but for rounding.
inline constexpr double kPole = 0.9, kPoleAngle_rad = 0.5;
inline constexpr NotchConfig kNotch{1000, 2, kPeriod_s};
inline constexpr std::size_t kAverage = 5;
inline constexpr std::size_t kWindow = 64;
inline constexpr std::size_t kHarmonics = 3;
inline constexpr LatticeArConfig kLattice{4, 0.1, 1};
inline constexpr MovingThresholdConfig kThreshold{10, 0.125, 2};
inline constexpr AngleSamplerConfig kSampler{12, 0.25};

/// Koike 2016, tables 3-4 to 3-6: the x axis.
inline DisturbanceObserverConfig observer() {
  DisturbanceObserverConfig c;
  c.sample_period_s = kPeriod_s;
  c.disturbance_cutoff_rad_s = 500;
  c.velocity_cutoff_rad_s = 1500;
  c.drive.inertia = 227;
  c.drive.viscous = 732;
  c.drive.coulomb = 94;
  c.drive.constant_load = 50;
  return c;
}

}  // namespace golden
