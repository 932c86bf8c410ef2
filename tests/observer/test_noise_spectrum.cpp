// Noise of the estimate, in closed form, against the observer itself on rounded motion and a noisy
// effort: power in bands of its spectrum.
#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/dsp/power_spectrum.hpp"
#include "servosense/observer/noise_spectrum.hpp"

using namespace servosense;

namespace {

// A spindle whose speed wanders by many counts a sample, so that rounding is white.
void against_the_observer(const NoiseSpectrumConfig& c, unsigned seed) {
  constexpr std::size_t kSegment = 512, kSamples = 400'000;
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  DisturbanceObserver<double> rounded, exact;
  rounded.configure(c.observer);
  exact.configure(c.observer);
  const double rate = 1 / c.observer.sample_period_s;
  PowerSpectrum spectrum(kSegment, rate);
  double x = 0, x_last = 0, shown_last = 0, v = 80, noise = 0;
  for (std::size_t i = 0; i < kSamples; ++i) {
    v += 0.02 * normal(random) - 1e-4 * (v - 80);
    x += v / rate;
    const double shown =
        c.unit_per_count > 0 ? std::floor(x / c.unit_per_count) * c.unit_per_count : x;
    if (i % c.effort_every == 0) noise = c.effort_noise * normal(random);
    DriveSample<double> s;
    s.quality = i == 0 ? Quality::restarted : Quality::good;
    s.position = shown;
    s.increment = i == 0 ? 0 : shown - shown_last;
    s.effort = 5 + noise;
    const double heard = rounded.process(s);
    s.position = x;
    s.increment = i == 0 ? 0 : x - x_last;
    s.effort = 5;
    const double true_value = exact.process(s);
    if (i > 1000) spectrum.add(heard - true_value);
    x_last = x;
    shown_last = shown;
  }
  const std::vector<double> f = spectrum.frequency_hz(), power = spectrum.power();
  for (const double from : {100.0, 200.0, 400.0, 800.0, 1600.0, 3000.0}) {
    double found = 0, expected = 0;
    for (std::size_t k = 0; k < f.size(); ++k)
      if (f[k] >= from && f[k] < 1.3 * from) {
        found += power[k];
        expected += noise_density(c, f[k]) * rate / kSegment;
      }
    // Two lines and 1500 half overlapping segments at least: 2 % standard error; a window of 16 Hz
    // over a slope of f^4 adds 1 % at 100 Hz.
    CHECK_NEAR(found / expected, 1, 0.08);
  }
}

}  // namespace

int main() {
  NoiseSpectrumConfig c;
  c.observer.drive.inertia = 5e-3;
  c.observer.disturbance_cutoff_rad_s = c.observer.velocity_cutoff_rad_s = 3500;
  c.unit_per_count = kTwoPi / 131072;
  against_the_observer(c, 41);
  c.observer.discretisation = Discretisation::backward_euler;
  against_the_observer(c, 42);
  c.observer.discretisation = Discretisation::tustin;
  c.unit_per_count = 0;
  c.effort_noise = 0.05;
  against_the_observer(c, 43);
  c.effort_every = 4;
  against_the_observer(c, 44);
  c.unit_per_count = kTwoPi / 1048576;
  c.observer.disturbance_cutoff_rad_s = 500;
  c.observer.velocity_cutoff_rad_s = 2000;
  against_the_observer(c, 45);
  return check::done();
}
