// Spectrum of the noise of a disturbance observer's estimate, in closed form (offline).
//
// Purpose: what a cut has to stand out from, before anything is measured: rounding of the counter
// and noise of the effort, through the observer (disturbance_observer.hpp, Koike 2016, eq. 2-23).
// Equation, with z^-1 = e^(-j 2 pi f T), LP and D the low-pass and the pseudo-derivative of
// first_order.hpp, one-sided [(Nm)^2/Hz]:
//   N(f) = 2 T { q^2/12 |J D_g D_h|^2 + s^2 / n |sin(n pi f T) / sin(pi f T)|^2 |LP_g LP_h|^2 }
// q one count, s the standard deviation of the effort, new every n samples and held in between. Far
// below g and h the first grows with the fourth power of the frequency, above them it is even.
// Rounding is white where the motion passes many counts a sample unevenly (Widrow and Kollar 2008,
// ch. 20: within 1 % from a fifth of a count of unevenness): in a cut. At constant speed it is
// lines, at the counts a sample and its multiples, of the same power in all.
// The estimate's own rounding is below both: 6e-8 of the effort in single precision.
// Bad at: drives whose reported motion is filtered.
#pragma once

#include <cmath>
#include <complex>

#include "servosense/core/units.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

struct NoiseSpectrumConfig {
  DisturbanceObserverConfig observer;  ///< inertia, cutoffs, sample period, discretisation
  double unit_per_count = 0;           ///< rad or m; 0: the motion is exact
  double effort_noise = 0;             ///< standard deviation of a new effort [Nm or N]
  unsigned effort_every = 1;           ///< samples from one new effort to the next
};

/// Density at a frequency from 0 to half the sample rate [square of the estimate's unit per Hz].
[[nodiscard]] inline double noise_density(const NoiseSpectrumConfig& c, double frequency_hz) {
  const double T = c.observer.sample_period_s;
  const std::complex<double> back = std::polar(1.0, -kTwoPi * frequency_hz * T);
  const bool tustin = c.observer.discretisation == Discretisation::tustin;
  const auto low_pass = [&](double cutoff_rad_s) {
    const double gT = cutoff_rad_s * T;
    return tustin ? gT * (1.0 + back) / (2 + gT - (2 - gT) * back) : gT / (1 + gT - back);
  };
  const auto derivative = [&](double cutoff_rad_s) {
    const double gT = cutoff_rad_s * T;
    const double gain = tustin ? 2 * gT / (2 + gT) : gT / (1 + gT);
    return gain / T * (1.0 - back) / (1.0 - (1 - gain) * back);
  };
  const double g = c.observer.disturbance_cutoff_rad_s, h = c.observer.velocity_cutoff_rad_s;
  const double counter = c.unit_per_count * c.unit_per_count / 12 *
                         std::norm(c.observer.drive.inertia * derivative(g) * derivative(h));
  const double n = c.effort_every, sine = std::sin(kPi * frequency_hz * T);
  const double held = std::abs(sine) < 1e-9 ? n : std::sin(n * kPi * frequency_hz * T) / sine;
  const double effort =
      c.effort_noise * c.effort_noise * held * held / n * std::norm(low_pass(g) * low_pass(h));
  return 2 * T * (counter + effort);
}

}  // namespace servosense
