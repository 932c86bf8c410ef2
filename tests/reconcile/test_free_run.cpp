// Models left to themselves, and under their controller. Oracles: motion and force by formulas, so
// that what a missing term and what noise do is known in closed form; and records of the drive
// simulator, whose truth must come out at the noise floor.
#include <cmath>
#include <string>
#include <vector>

#include "check.hpp"
#include "random_axis.hpp"
#include "reconcile/drive/closed_loop.hpp"
#include "reconcile/drive/free_run.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kCorner_hz = 70;
constexpr double kNoiseBandwidth_hz = 1.0645 * kCorner_hz;  // integral of 2^-u^2
constexpr double kTwoPi_ = 6.283185307179586;

/// 1 kHz, 95 kg, always forward, `coulomb` N and `viscous` N s/m of friction; nothing is rounded.
DriveData forward(double coulomb, double viscous) {
  DriveData d;
  d.sample_period_s = d.servo_period_s = 1e-3;
  d.model.inertia = 95;
  d.model.viscous = viscous;
  d.model.unit_per_turn = 0.01;
  double last = 0;
  for (int i = 0; i < 12000; ++i) {
    const double t = i * 1e-3, w = kTwoPi_ * 0.7;
    const double x = 0.2 * t + 0.02 * std::sin(w * t);
    const double v = 0.2 + 0.02 * w * std::cos(w * t), a = -0.02 * w * w * std::sin(w * t);
    DriveSample<double> s;
    s.increment = x - last;
    s.effort = 95 * a + viscous * v + coulomb;
    d.samples.push_back(s);
    last = x;
  }
  return d;
}

FreeRunConditions last_third(double force_noise) {
  FreeRunConditions c;
  c.from_s = 8;
  c.to_s = 12;
  c.least_speed = 0.01;
  c.force_noise = force_noise;
  return c;
}

void by_formulas() {
  for (const double viscous : {0.0, 300.0}) {
    const DriveData d = forward(20, viscous);
    const DriveSignals signals(d, kCorner_hz);
    FreeModel before{d.model, 0}, after{d.model, 0};
    after.drive.coulomb = 20;
    const FreeRun run = free_run(d, signals, before, after, last_third(0.3));
    CHECK_TEXT(run.not_shown, "");
    CHECK(run.starts == 64 && run.horizons.size() == 4);
    for (const FreeRun::Horizon& h : run.horizons) {
      const double t = h.horizon_s;
      // M v' = 20 N - D v from rest: 0.5 F/M t^2 without friction.
      const double settled = 1 - std::exp(-viscous * t / 95);
      const double speed = viscous > 0 ? 20 / viscous * settled : 20 / 95.0 * t;
      const double travel =
          viscous > 0 ? 20 / viscous * (t - 95 / viscous * settled) : 0.5 * 20 / 95 * t * t;
      // Straight lines between samples of a force of 4 rad/s: (w T)^2 / 8 = 2e-6 of it.
      CHECK_NEAR(h.position.before, travel, 1e-3 * travel + 1e-7);
      CHECK_NEAR(h.speed.before, speed, 1e-3 * speed + 1e-5);
      CHECK_BETWEEN(h.position.after, 0, 1e-6);
      // White force of the density that has 0.3 N behind the filter, integrated twice: an
      // upper bound with friction. 64 runs: 9 %.
      const double density = 0.3 * 0.3 / (2 * kNoiseBandwidth_hz);
      const double walk = std::sqrt(density * t * t * t / 3) / 95;
      if (viscous > 0)
        CHECK_BETWEEN(h.position.floor, 0.4 * walk, 1.36 * walk);
      else
        CHECK_BETWEEN(h.position.floor, 0.64 * walk, 1.36 * walk);
    }
  }
}

/// Rounded positions alone: the error of the first speed, carried on.
void rounding_floor() {
  DriveData d = forward(0, 0);
  d.unit_per_count = 1e-6;
  const DriveSignals signals(d, kCorner_hz);
  const FreeRun run = free_run(d, signals, {d.model, 0}, {d.model, 0}, last_third(0));
  const double rounding = 1e-6 / std::sqrt(12.0);
  // Slope of a cubic over 2 n + 1 points: variance 75 / (8 n^3), n = 0.4 / corner / T.
  const double speed = rounding / 1e-3 * std::sqrt(75.0 / 8 / std::pow(6.5, 3));
  CHECK(run.horizons.size() == 4);
  for (const FreeRun::Horizon& h : run.horizons) {
    const double expected = std::hypot(speed * h.horizon_s, rounding * std::sqrt(2.0));
    CHECK_BETWEEN(h.position.floor, 0.64 * expected, 1.36 * expected);
  }
}

EffectSetting effect(const char* name, std::initializer_list<double> values) {
  EffectSetting s;
  s.effect = drive_effect_index(name);
  std::size_t p = 0;
  for (const double v : values) s.parameters[p++] = {{v}, 1};
  return s;
}

Trajectory program() {
  Trajectory t(0.0);
  const MotionLimits limits{0.25, 2, 40};
  for (int lap = 0; lap < 3; ++lap)
    for (const double to : {0.12, 0.1, 0.2, -0.05, 0.0}) {
      (void)t.move_to(to, limits);
      (void)t.dwell(0.1);
    }
  return t;
}

/// What the simulator did, left to itself with its own parameters: nothing but noise may remain.
void at_the_floor() {
  const EffectSetting effects[] = {
      effect("coulomb-friction", {60}),           effect("flexible-coupling", {60, 0.05, 0.4}),
      effect("encoder-eccentricity", {3e-3, 1}),  effect("torque-ripple", {3, 25, 0.5}),
      effect("transport-delay", {3e-3}),          effect("spring-load", {800, 0.02}),
      effect("presliding-hysteresis", {1e6, 60}),
  };
  unsigned seed = 31;
  for (const EffectSetting& hidden : effects) {
    const std::string name = kDriveEffects[hidden.effect].name;
    random_axis::Between between{std::mt19937_64(seed)};
    DriveSimulatorConfig machine = random_axis::draw(between, seed);
    machine.drive.effects.settings[0] = hidden;
    machine.drive.effects.count = 1;
    FreeModel without{machine.drive, random_axis::kPeriod / 2}, with = without;
    without.drive.effects.count = 0;
    const Trajectory motion = program();
    DriveData d = random_axis::record(machine, without.drive, motion);
    const DriveSignals signals(d, kCorner_hz);
    FreeRunConditions c = last_third(machine.current_noise_A * machine.effort_per_A *
                                     std::sqrt(2 * kNoiseBandwidth_hz * random_axis::kPeriod));
    c.from_s = 0.6 * motion.duration_s();
    c.to_s = motion.duration_s();
    const FreeRun run = free_run(d, signals, without, with, c);
    CHECK(run.horizons.size() == 4);
    const int failures = check::failures;
    // Half a second fits six times into the held-out part, so the rms of 64 runs scatters by 30 %.
    for (const FreeRun::Horizon& h : run.horizons)
      CHECK_BETWEEN(h.position.after / h.position.floor, 0.5, 1.7);
    CHECK(!run.horizons.empty() &&
          run.horizons.back().position.before > 1.9 * run.horizons.back().position.after);

    // Under its controller the drive moves as it did, up to the last count.
    d.loop = machine;
    for (std::size_t i = 0; i < d.samples.size(); ++i)
      d.command.push_back(motion.at(static_cast<double>(i) * random_axis::kPeriod).position);
    const ClosedLoop loop = closed_loop(d, without, with, kCorner_hz, c.from_s, c.to_s);
    CHECK_TEXT(loop.not_shown, "");
    CHECK_BETWEEN(loop.position_after, 0, 0.5 * d.unit_per_count);
    CHECK_BETWEEN(loop.effort_after / c.force_noise, 0.8, 1.2);
    CHECK(loop.position_before > loop.position_after);
    CHECK(loop.effort_before > 1.5 * loop.effort_after);
    CHECK(loop.following_rms > 10 * loop.position_before);
    if (check::failures > failures) {
      std::printf("  %s, seed %u; under its controller %g, %g m, %g, %g N, following %g m\n",
                  name.c_str(), seed, loop.position_before, loop.position_after, loop.effort_before,
                  loop.effort_after, loop.following_rms);
      for (const FreeRun::Horizon& h : run.horizons)
        std::printf("  %4.0f ms: %.3g, %.3g, floor %.3g m\n", 1000 * h.horizon_s, h.position.before,
                    h.position.after, h.position.floor);
    }
    ++seed;
  }
}

}  // namespace

int main() {
  by_formulas();
  rounding_floor();
  at_the_floor();
  return check::done();
}
