// A drive under a P-PI cascade that sees the counted position, recorded: for what the loop makes of
// its encoder.
#pragma once

#include <algorithm>
#include <cmath>
#include <random>

#include "servosense/core/units.hpp"
#include "servosense/reconcile/drive.hpp"

/// Speeds up and down in both directions, drawn between a share of the top speed and all of it.
/// Units of an axis or of a spindle.
struct DriveUnderControl {
  double inertia, viscous, coulomb;
  double bristle;  ///< travel of friction
  double quantum, bandwidth_hz;
  double filter;  ///< of the measured speed, share of the new value in each period
  double top_speed, least_level, acceleration;
  double change_s, length_s;
  double noise;  ///< of the reported effort
  unsigned seed;
  double resonance_hz = 0;  ///< of motor and load, free; 0: one mass
  double damping_ratio = 0, load_share = 0;
  double rubbing_share = 0;      ///< of the friction, at the load
  double limit = 0;              ///< of the effort that acts; what is asked for is reported
  double push = 0, push_hz = 0;  ///< a force on the motor whose phase wanders
  double coulomb_lost = 0, viscous_lost = 0;  ///< shares of friction that are gone once it is warm
  double warming_s = 1;                       ///< time constant of that

  /// Appends the record to `d`, which says the sample period and the length of a turn.
  void record(servosense::reconcile::DriveData& d) const {
    using servosense::kTwoPi;
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> level(least_level, 1.0);
    constexpr int kSteps = 20;
    const double period = d.sample_period_s, step = period / kSteps;
    const bool two = resonance_hz > 0;
    const double motor = (1 - load_share) * inertia, load = load_share * inertia;
    const double reduced = (1 - load_share) * load, w = kTwoPi * resonance_hz;
    const double stiffness = reduced * w * w, damping = reduced * 2 * damping_ratio * w;
    const double bandwidth = kTwoPi * bandwidth_hz;
    double x = 0, v = 0, x_load = 0, v_load = 0, wanted_x = 0, wanted_v = 0, goal = 0;
    double integral = 0, filtered = 0, seen = 0, effort = 0;
    double friction = 0, friction_load = 0, push_phase = 0;
    int sign = 1;
    const auto change = std::lround(change_s / period), length = std::lround(length_s / period);
    for (long i = 0; i < length; ++i) {
      if (i % change == 0) {
        goal = sign * top_speed * level(random);
        sign = -sign;
      }
      const double most = acceleration * period;
      wanted_v += std::min(most, std::max(-most, goal - wanted_v));
      wanted_x += wanted_v * period;
      const double measured = quantum * std::floor(x / quantum);
      const double turns = measured / d.model.unit_per_turn;
      servosense::DriveSample<double> sample;
      sample.increment = d.samples.empty() ? 0 : measured - d.samples.back().position;
      sample.position = measured;
      sample.turn_angle_rad = kTwoPi * (turns - std::floor(turns));
      sample.effort = effort + noise * normal(random);
      d.samples.push_back(sample);
      filtered += filter * ((measured - seen) / period - filtered);
      seen = measured;
      const double error = wanted_v + 0.2 * bandwidth * (wanted_x - measured) - filtered;
      integral += error * period * bandwidth / 6;
      effort = inertia * bandwidth * (error + integral);
      if (push > 0) push_phase += kTwoPi * push_hz * period + 0.1 * normal(random);
      const double pushed = push * std::sin(push_phase);
      const double warmth = -std::expm1(-static_cast<double>(i) * period / warming_s);
      const double sliding = coulomb * (1 - coulomb_lost * warmth);
      const double growing = viscous * (1 - viscous_lost * warmth);
      const double acting = limit > 0 ? std::clamp(effort, -limit, limit) : effort;
      for (int k = 0; k < kSteps; ++k) {
        // Dahl's bristles, advanced exactly.
        const auto rub = [&](double& bent, double speed) {
          const double end = speed > 0 ? sliding : -sliding;
          if (speed != 0) bent = end + (bent - end) * std::exp(-std::abs(speed) * step / bristle);
          return bent + growing * speed;
        };
        const double passed = two ? stiffness * (x - x_load) + damping * (v - v_load) : 0;
        v += (acting + pushed - (1 - rubbing_share) * rub(friction, v) - passed) / motor * step;
        if (two) v_load += (passed - rubbing_share * rub(friction_load, v_load)) / load * step;
        x += v * step;
        x_load += v_load * step;
      }
    }
  }
};

/// An axis of 100 kg and 40 N; its encoder, its noise and its seed are the caller's.
inline DriveUnderControl axis_under_control() {
  return {.inertia = 100,
          .viscous = 150,
          .coulomb = 40,
          .bristle = 2e-6,
          .quantum = 1e-7,
          .bandwidth_hz = 20,
          .filter = 0.4,
          .top_speed = 0.15,
          .least_level = 0.05,
          .acceleration = 2.5,
          .change_s = 0.35,
          .length_s = 7,
          .noise = 4,
          .seed = 1};
}

/// What `axis` records, with a machine file that is some per cent off.
inline servosense::reconcile::DriveData record_of(const DriveUnderControl& axis, double period_s) {
  servosense::reconcile::DriveData d;
  d.channel = servosense::Channel::x;
  d.sample_period_s = d.servo_period_s = period_s;
  d.model.inertia = 1.05 * axis.inertia;
  d.model.viscous = 0.93 * axis.viscous;
  d.model.coulomb = 1.05 * axis.coulomb;
  d.model.unit_per_turn = 0.01;
  d.model.friction_knee = axis.bristle;
  d.observer.drive = d.model;
  d.unit_per_count = axis.quantum;
  axis.record(d);
  return d;
}
