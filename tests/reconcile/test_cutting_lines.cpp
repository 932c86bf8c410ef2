// Lines fixed in time in what a cut leaves: one of the surroundings is found, with the errors it
// says; one among much that drifts (hard spots, wear) is a part of that and gets no name, nor does
// one that is larger where more is cut.
#include <cmath>
#include <random>

#include "check.hpp"
#include "reconcile/cut/lines.hpp"
#include "servosense/core/units.hpp"

using namespace servosense;
using namespace servosense::reconcile;

namespace {

constexpr double kPeriod_s = 1e-4, kNoise_N = 10;
constexpr int kSamples = 30000;

/// A line of 12 N along x and 5 N along y in white noise, beside a drift of so many newtons rms
/// that forgets itself within 2 ms.
LineSearch record(const Column& time_s, const Column& feed_m, double hz, double drift_N,
                  unsigned seed) {
  LineSearch s{time_s, feed_m, {}, {}, {}, {}, {}, {}};
  std::mt19937 random(seed);
  std::normal_distribution<double> noise;
  constexpr double kKept = 1 - kPeriod_s / 0.002;
  double drift = 0;
  for (int i = 0; i < kSamples; ++i) {
    const double t = time_s[static_cast<std::size_t>(i)];
    drift = kKept * drift + drift_N * std::sqrt(1 - kKept * kKept) * noise(random);
    s.x_N.push_back(12 * std::cos(kTwoPi * hz * t + 0.4) + drift + kNoise_N * noise(random));
    s.y_N.push_back(5 * std::cos(kTwoPi * hz * t + 1.1) + drift + kNoise_N * noise(random));
    s.fitted.push_back(i < 2 * kSamples / 3);
    s.held_out.push_back(i >= 2 * kSamples / 3);
  }
  s.finer_x_N = s.x_N;
  s.finer_y_N = s.y_N;
  s.turn_hz = 50;
  s.most_hz = 2000;
  s.least_N = 1;
  return s;
}

}  // namespace

int main() {
  Column time_s, feed_m;
  for (int i = 0; i < kSamples; ++i) {
    time_s.push_back(i * kPeriod_s);
    feed_m.push_back(i % (kSamples / 2) < kSamples / 4 ? 1e-4 : 1.5e-4);
  }
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const auto lines = find_lines(record(time_s, feed_m, 83.7, 0, seed));
    CHECK(lines.size() == 1);
    if (lines.size() != 1) continue;
    // Least squares: errors of sigma sqrt(2 / n), n = 20000; Rife and Boorstyn (1974) for the
    // frequency. Four standard errors.
    const double error_N = kNoise_N * std::sqrt(2.0 / (2 * kSamples / 3));
    CHECK_NEAR(lines[0].amplitude_N(0), 12, 4 * error_N);
    CHECK_NEAR(lines[0].amplitude_N(1), 5, 4 * error_N);
    CHECK_NEAR(lines[0].frequency_hz, 83.7, 4 * lines[0].frequency_error_hz);
    CHECK(lines[0].frequency_error_hz < 0.01);

    CHECK(find_lines(record(time_s, feed_m, 83.7, 13, seed)).empty());

    LineSearch of_cut = record(time_s, feed_m, 83.7, 0, seed);
    for (Column* force : {&of_cut.x_N, &of_cut.y_N, &of_cut.finer_x_N, &of_cut.finer_y_N})
      for (std::size_t i = 0; i < force->size(); ++i) (*force)[i] *= feed_m[i] / 1.25e-4;
    CHECK(find_lines(of_cut).empty());
  }
  return check::done();
}
