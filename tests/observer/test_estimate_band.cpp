// The band of the estimate holds the true force, at rest and in motion. The drive is the shop's
// (oracles/shop_drive.hpp: bristles, Stribeck, cascade control); the observer's parameters are off
// by what a machine file may be off by; the truth is the load through two poles of the test's own.
// Seeds 1 to 20 served development, 501 on are judged.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <random>
#include <vector>

#include "check.hpp"
#include "oracles/shop_drive.hpp"
#include "servosense/observer/estimate_band.hpp"

namespace {

using namespace servosense;
using oracle::Motion;
using oracle::ShopDrive;

/// Smooth moves (cosine), a dwell after each.
struct Moves {
  double distance = 0.05, move_s = 0.5, dwell_s = 0.5;
  int same_way = 1;  // moves before it turns round
  [[nodiscard]] Motion at(double t) const {
    const double step_s = move_s + dwell_s;
    const int k = static_cast<int>(t / step_s);
    const int cycle = k % (2 * same_way);
    const double from = distance * (cycle < same_way ? cycle : 2 * same_way - cycle);
    const double way = cycle < same_way ? distance : -distance;
    const double s = std::min((t - k * step_s) / move_s, 1.0);
    const double w = oracle::kPi / move_s;
    const bool moves = s < 1;
    return {from + way * (1 - std::cos(oracle::kPi * s)) / 2,
            moves ? way * w * std::sin(oracle::kPi * s) / 2 : 0,
            moves ? way * w * w * std::cos(oracle::kPi * s) / 2 : 0};
  }
};

struct Tally {
  double rest = 0, rest_inside = 0, moving = 0, moving_inside = 0;
  double fast = 0, fast_error = 0, fast_band = 0;  // sliding for long
  double widest = 0;                               // in Coulomb frictions
  double worst = 0;                                // error at rest, likewise
  double alone = 0;                                // at rest, within the band of motion alone
};

/// `load(t)` opposes positive motion.
template <typename Load>
void judge(const ShopDrive& d, const Moves& moves, double seconds, unsigned seed, Load&& load,
           Tally& tally) {
  constexpr double kCutoff = 500;
  std::mt19937 random(seed * 31);
  const auto off = [&](double share) {
    return 1 + std::uniform_real_distribution<double>(-share, share)(random);
  };
  DisturbanceObserverConfig c;
  c.sample_period_s = d.period_s;
  c.disturbance_cutoff_rad_s = c.velocity_cutoff_rad_s = kCutoff;
  c.drive.inertia = d.inertia * off(0.01);
  c.drive.viscous = d.viscous * off(0.05);
  c.drive.coulomb = d.coulomb * off(0.05);
  c.drive.constant_load = d.constant_load * off(0.01);
  c.drive.friction_knee = std::max(5e-6, 4 * d.count);
  if (d.bristle > 5e-6) {  // as identify presliding would have found it
    c.drive.effects.count = 1;
    EffectSetting& bristle = c.drive.effects.settings[0];
    bristle.effect = drive_effect_index("presliding-hysteresis");
    bristle.parameters[0] = {{d.coulomb / d.bristle * off(0.1)}, 1};
    bristle.parameters[1] = {{d.coulomb * off(0.1)}, 1};
  }
  DisturbanceObserver<double> observer;
  observer.configure(c);
  EstimateBand<double> band;
  // White noise of the effort behind both poles (docs/identify-idle.md).
  const auto config = estimate_band_of(
      c, 1.22 * d.effort_noise * std::sqrt(kCutoff * d.period_s / 4), d.count, false);
  CHECK(EstimateBand<double>::validate(config).ok());
  band.configure(config);
  const auto run = d.run(
      seconds, seed, [&](double t) { return moves.at(t); },
      [&](double t, double, double) { return load(t); });
  double first = load(0), truth = first;
  for (std::size_t i = 0; i < run.size(); ++i) {
    const double t = static_cast<double>(i) * d.period_s;
    constexpr int kFine = 8;
    for (int k = 0; k < kFine; ++k) {
      const double h = d.period_s / kFine;
      first += (load(t - d.period_s + (k + 0.5) * h) - first) * (1 - std::exp(-kCutoff * h));
      truth += (first - truth) * (1 - std::exp(-kCutoff * h));
    }
    DriveSample<double> s;
    s.increment = i == 0 ? 0 : static_cast<double>(run[i].counts - run[i - 1].counts) * d.count;
    s.effort = run[i].effort;
    if (i == 0) s.quality = Quality::restarted;
    const double estimate = observer.process(s);
    const double half = band.process(s.increment, s.quality);
    if (t < 0.1) continue;
    const double error = std::abs(estimate - truth);
    const bool rests = moves.at(t).v == 0;
    (rests ? tally.rest : tally.moving) += 1;
    (rests ? tally.rest_inside : tally.moving_inside) += error <= half;
    tally.widest = std::max(tally.widest, half / d.coulomb);
    if (rests) tally.worst = std::max(tally.worst, error / d.coulomb);
    if (rests) tally.alone += error <= half - band.state().at_rest;
    if (band.state().at_rest < 0.01 * d.coulomb) {
      tally.fast += 1;
      tally.fast_error += error * error;
      tally.fast_band += half;
    }
  }
}

void report(const char* name, const Tally& t) {
  const double rms = std::sqrt(t.fast_error / std::max(t.fast, 1.0));
  std::printf(
      "  %-34s at rest %7.3f %% inside (%5.1f %% without what rest adds), moving %7.3f %%; "
      "sliding: "
      "band %.1f times the error (rms); widest %.2f Coulomb, worst error at rest %.2f\n",
      name, 100 * t.rest_inside / t.rest, 100 * t.alone / t.rest, 100 * t.moving_inside / t.moving,
      t.fast > 0 ? t.fast_band / t.fast / rms : 0.0, t.widest, t.worst);
  CHECK(t.rest_inside >= 0.99 * t.rest);
  CHECK(t.moving_inside >= 0.99 * t.moving);
  // Not because anything would be inside.
  CHECK(t.widest < 3.1);
  if (t.fast > 0) CHECK(t.fast_band / t.fast < 8 * rms);
}

void judge_all() {
  struct Case {
    const char* name;
    double stribeck, weight, move_s;
    int same_way;
    bool pushed;
    double bristle = 0, counts = 1 << 20, current_loop_hz = 0;
  };
  for (const Case& c :
       {Case{"reversals and dwells", 0, 0, 0.5, 1, false},
        Case{"one way, then back", 0, 0, 0.5, 3, false},
        Case{"loads at rest and in motion", 0, 0, 0.5, 2, true},
        Case{"vertical, loads", 0, 1716, 0.5, 2, true},
        Case{"Stribeck, 40 %, loads", 0.4, 0, 0.5, 1, true},
        Case{"creeping, stick and slip", 0.4, 0, 4, 1, true},
        Case{"bristles of 30 um, known, loads", 0, 0, 0.5, 2, true, 30e-6},
        Case{"bristles of 8 um, known, creeping", 0.4, 0, 4, 1, true, 8e-6},
        Case{"the same, 4000 counts a turn", 0.4, 0, 4, 1, true, 8e-6, 4000},
        Case{"current loop of 300 Hz, loads", 0, 0, 0.5, 2, true, 0, 1 << 20, 300}}) {
    Tally tally;
    for (unsigned seed = 501; seed < 509; ++seed) {
      std::mt19937 random(seed);
      const auto within = [&](double low, double high) {
        return std::uniform_real_distribution<double>(low, high)(random);
      };
      ShopDrive d;
      d.stribeck = c.stribeck;
      d.constant_load = c.weight;
      d.coulomb *= within(0.7, 1.5);
      d.bristle = c.bristle > 0 ? c.bristle : within(0.5e-6, 4e-6);
      d.count = 0.016 / c.counts;
      d.current_loop_rad_s = 2 * oracle::kPi * c.current_loop_hz;
      Moves moves;
      moves.move_s = c.move_s;
      moves.same_way = c.same_way;
      moves.distance = c.move_s > 1 ? 2e-4 : within(0.02, 0.1);
      // Steps and a slow swing; at rest below breakaway and beyond it.
      const double step = within(20, 300), swing = within(20, 200), rate = within(2, 9);
      judge(
          d, moves, 8, seed,
          [&](double t) {
            if (!c.pushed || t < 0.5) return 0.0;
            return (static_cast<int>(t * 1.7) % 2 == 0 ? step : 0) + swing * std::sin(rate * t);
          },
          tally);
    }
    report(c.name, tally);
  }
}

void faults() {
  EstimateBandConfig c;
  c.coulomb = 100;
  c.noise = 1;
  EstimateBand<float> band;
  CHECK(EstimateBand<float>::validate(c).ok());
  band.configure(c);
  // Wholly at rest: static friction either way; after a long move the sliding band.
  for (int i = 0; i < 1000; ++i) band.process(0, Quality::good);
  CHECK_NEAR(static_cast<double>(band.state().half_width), 3 + 10 + 150, 0.1);
  for (int i = 0; i < 8000; ++i) band.process(1e-6F, Quality::good);
  CHECK_NEAR(static_cast<double>(band.state().half_width), 3 + 10 + 50 / 1.16, 0.1);
  const float before = band.state().half_width;
  CHECK(band.process(std::numeric_limits<float>::quiet_NaN(), Quality::good) == before);
  CHECK(band.process(0, Quality::gap) == before);
  band.process(1e-6F, Quality::good);  // nobody knows what it did in between
  CHECK(band.state().half_width > 100);
  // A count of noise at rest is no slip.
  band.reset();
  for (int i = 0; i < 80000; ++i) band.process(i % 2 == 0 ? 1e-6F : -1e-6F, Quality::good);
  CHECK(band.state().half_width > 150);
}

void refusals() {
  auto refused = [](auto change, const char* parameter) {
    EstimateBandConfig c;
    change(c);
    const Status s = EstimateBand<float>::validate(c);
    CHECK(!s.ok());
    CHECK_TEXT(s.parameter(), parameter);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const char* shares = "noise, inertia, friction and shares";
  refused([](auto& c) { c.friction_knee = 0; }, "friction_knee");
  refused([](auto& c) { c.sample_period_s = 0; }, "sample_period_s");
  refused([](auto& c) { c.cutoff_rad_s = 0; }, "cutoff_rad_s");
  refused([](auto& c) { c.cutoff_rad_s = 2 / c.sample_period_s; }, "cutoff_rad_s");
  refused([](auto& c) { c.stribeck_speed = 0; }, "stribeck_speed");
  refused([](auto& c) { c.memory_s = -1; }, "memory_s");
  refused([&](auto& c) { c.constant_load = nan; }, "constant_load");
  refused([](auto& c) { c.coulomb = -1; }, shares);
  refused([&](auto& c) { c.noise = nan; }, shares);
  refused([](auto& c) { c.rest_share = std::numeric_limits<double>::infinity(); }, shares);
}

// A table of 0.1 m turns at ten times the angle for a speed in m/s. What holds a drive at rest is
// known to a quarter and to what a count moves the bristle by; where that is no better, not at all.
void from_the_observer() {
  DisturbanceObserverConfig c;
  c.drive.coulomb = 100;
  c.drive.friction_knee = 5e-6;
  const double speed = EstimateBandConfig{}.stribeck_speed;
  CHECK_NEAR(estimate_band_of(c, 1, 1e-6, true).stribeck_speed, 10 * speed, 1e-12);
  CHECK_NEAR(estimate_band_of(c, 1, 1e-6, false).stribeck_speed, speed, 1e-12);
  CHECK(estimate_band_of(c, 1, 1e-6, false).rest_share == 1);
  EffectSetting& bristle = c.drive.effects.settings[0];
  bristle.effect = drive_effect_index("presliding-hysteresis");
  bristle.parameters[0] = {{1e7}, 1};  // N/m
  bristle.parameters[1] = {{80}, 1};   // N
  c.drive.effects.count = 1;
  CHECK_NEAR(estimate_band_of(c, 1, 1e-6, false).rest_share, 0.25 + 2 * 1e-6 * 1e7 / 100, 1e-12);
  CHECK_NEAR(estimate_band_of(c, 1, 1e-6, false).friction_knee, 1.5 * 80 / 1e7, 1e-15);
  CHECK(estimate_band_of(c, 1, 0, false).rest_share == 1);     // a count is not known
  CHECK(estimate_band_of(c, 1, 1e-5, false).rest_share == 1);  // or coarse
}

}  // namespace

int main() {
  judge_all();
  faults();
  refusals();
  from_the_observer();
  return check::done();
}
