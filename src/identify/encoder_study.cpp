#include "servosense/identify/encoder_study.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstddef>
#include <vector>

#include "dsp/fourier.hpp"
#include "servosense/observer/disturbance_observer.hpp"

namespace servosense {

double encoder_noise(const EncoderStudyDrive& drive, double counts_per_turn, double cutoff_rad_s) {
  constexpr std::size_t kSamples = 15360;
  DisturbanceObserverConfig c;
  c.sample_period_s = drive.sample_period_s;
  c.disturbance_cutoff_rad_s = c.velocity_cutoff_rad_s = cutoff_rad_s;
  c.drive.inertia = drive.inertia;
  DisturbanceObserver<double> observer;
  observer.configure(c);
  const double count = drive.travel_per_turn / counts_per_turn;
  const double step = drive.speed * drive.sample_period_s / count;  // counts a sample
  const auto settled = static_cast<std::size_t>(40 / (cutoff_rad_s * drive.sample_period_s)) + 2;
  std::vector<double> estimate;
  double before = 0;
  for (std::size_t i = 1; estimate.size() < kSamples; ++i) {
    // A third of a count off, so that no reading sits on the edge of one.
    const double now = std::floor(step * static_cast<double>(i) + 1.0 / 3);
    DriveSample<double> sample;
    sample.increment = count * (now - before);
    sample.position = count * now;
    before = now;
    const double torque = observer.process(sample);
    if (i > settled) estimate.push_back(torque);
  }
  const std::vector<std::complex<double>> lines = fourier_lines(estimate);
  double largest = 0;
  for (std::size_t m = 1; m < kSamples / 2; ++m) largest = std::max(largest, std::abs(lines[m]));
  return 2 * largest / static_cast<double>(kSamples);
}

}  // namespace servosense
