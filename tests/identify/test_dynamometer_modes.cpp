// Modes of a dynamometer from its response: made by the test's own formula, with noise; and as the
// program does it, from a hammer's record.
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/identify/dynamometer_modes.hpp"

namespace {

using namespace servosense;
using Complex = std::complex<double>;

Complex response(const std::vector<DynamometerMode>& modes, double hz) {
  Complex h = 1;
  for (const DynamometerMode& m : modes) {
    const double w = m.natural_frequency_hz;
    h += m.share * (w * w / Complex(w * w - hz * hz, 2 * m.damping_ratio * w * hz) - 1.);
  }
  return h;
}

struct Measured {
  std::vector<double> hz;
  std::vector<Complex> value;
};
/// 20 to 4000 Hz in lines of 5 Hz; the noise is a share of |H|, as of a hammer's force.
Measured measured(const std::vector<DynamometerMode>& modes, double gain, double noise,
                  unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0, noise);
  Measured m;
  for (double hz = 20; hz <= 4000; hz += 5) {
    m.hz.push_back(hz);
    m.value.push_back(gain * response(modes, hz) * (1. + Complex(normal(random), normal(random))));
  }
  return m;
}

void found_again() {
  const std::vector<DynamometerMode> one{{930, 0.03, 0.9}};
  const std::vector<DynamometerMode> three{
      {930, 0.03, 0.7}, {1650, 0.02, -0.1}, {2480, 0.04, 0.25}};
  for (const auto* modes : {&one, &three}) {
    const Measured clean = measured(*modes, 1, 0, 1);
    const auto exact = fit_dynamometer_modes(clean.hz, clean.value);
    CHECK(exact.has_value() && exact->modes.size() == modes->size());
    if (!exact || exact->modes.size() != modes->size()) continue;
    for (std::size_t k = 0; k < modes->size(); ++k) {
      CHECK_NEAR(exact->modes[k].natural_frequency_hz / (*modes)[k].natural_frequency_hz, 1, 1e-6);
      CHECK_NEAR(exact->modes[k].damping_ratio / (*modes)[k].damping_ratio, 1, 1e-5);
      CHECK_NEAR(exact->modes[k].share, (*modes)[k].share, 1e-5);
    }
    double worst_hz = 0, worst_damping = 0, worst_share = 0;
    for (unsigned seed = 801; seed < 811; ++seed) {
      const Measured m = measured(*modes, 0.96, 0.02, seed);
      const auto fit = fit_dynamometer_modes(m.hz, m.value);
      CHECK(fit.has_value() && fit->modes.size() == modes->size());
      if (!fit || fit->modes.size() != modes->size()) continue;
      CHECK_NEAR(fit->static_gain, 0.96, 0.01);
      CHECK_BETWEEN(fit->misfit, 0.015, 0.045);
      for (std::size_t k = 0; k < modes->size(); ++k) {
        const DynamometerMode& found = fit->modes[k];
        const DynamometerMode& true_mode = (*modes)[k];
        worst_hz = std::max(
            worst_hz, std::abs(found.natural_frequency_hz / true_mode.natural_frequency_hz - 1));
        worst_damping =
            std::max(worst_damping, std::abs(found.damping_ratio / true_mode.damping_ratio - 1));
        worst_share = std::max(worst_share, std::abs(found.share - true_mode.share));
      }
    }
    std::printf(
        "%zu modes, noise 2 %%, 10 responses: frequency within %.3f %%, damping %.1f %%, "
        "share %.4f\n",
        modes->size(), 100 * worst_hz, 100 * worst_damping, worst_share);
    CHECK_BETWEEN(worst_hz, 0, 0.002);
    CHECK_BETWEEN(worst_damping, 0, 0.05);
    CHECK_BETWEEN(worst_share, 0, 0.01);
  }
}

/// Errors as stated: intervals of 95 % hold in 90 to 99 of 100, of responses whose noise is alike
/// in neighbouring lines (as of a window over the record), too.
void errors_as_stated() {
  const std::vector<DynamometerMode> modes{{930, 0.03, 0.7}, {2480, 0.04, 0.25}};
  constexpr double kNinetyFive = 1.96;
  for (const bool alike : {false, true}) {
    std::array<int, 3> held{};
    int count = 0;
    for (unsigned seed = 20001; seed <= 20150; ++seed) {
      Measured m = measured(modes, 1.02, 0, 1);
      std::mt19937 random(seed);
      std::normal_distribution<double> normal(0, 0.02);
      std::vector<Complex> noise;
      for (std::size_t i = 0; i < m.value.size() + 2; ++i)
        noise.push_back({normal(random), normal(random)});
      for (std::size_t i = 0; i < m.value.size(); ++i)
        m.value[i] *=
            1. + (alike ? (noise[i] + 2. * noise[i + 1] + noise[i + 2]) / std::sqrt(6.) : noise[i]);
      DynamometerFitOptions two;
      two.modes = 2;
      const auto fit = fit_dynamometer_modes(m.hz, m.value, two);
      CHECK(fit.has_value() && fit->standard_errors.size() == 2);
      if (!fit) continue;
      for (std::size_t k = 0; k < 2; ++k) {
        const DynamometerMode &found = fit->modes[k], &error = fit->standard_errors[k];
        held[0] += std::abs(found.natural_frequency_hz - modes[k].natural_frequency_hz) <
                   kNinetyFive * error.natural_frequency_hz;
        held[1] += std::abs(found.damping_ratio - modes[k].damping_ratio) <
                   kNinetyFive * error.damping_ratio;
        held[2] += std::abs(found.share - modes[k].share) < kNinetyFive * error.share;
        ++count;
      }
    }
    const char* names[] = {"frequency", "damping", "share"};
    for (std::size_t i = 0; i < held.size(); ++i) {
      const double share = 100.0 * held[i] / count;
      check::figure(std::string("intervals of 95 % hold, ") + names[i] +
                        (alike ? ", noise alike in neighbours" : ""),
                    share, "of 100");
      CHECK_BETWEEN(share, 90, 99);
    }
  }
}

/// An exponential window moves the response to s = rate + jw, and nothing else.
void behind_a_window() {
  const std::vector<DynamometerMode> modes{{930, 0.03, 0.9}};
  constexpr double kRate = 60, kTurn = 6.283185307179586;
  Measured m;
  for (double hz = 20; hz <= 3000; hz += 5) {
    const Complex s(kRate, kTurn * hz);
    const double w = kTurn * 930;
    m.hz.push_back(hz);
    m.value.push_back(1. + 0.9 * (w * w / (s * s + 2 * 0.03 * w * s + w * w) - 1.));
  }
  DynamometerFitOptions options;
  options.exponential_window_per_s = kRate;
  const auto fit = fit_dynamometer_modes(m.hz, m.value, options);
  CHECK(fit.has_value() && fit->modes.size() == 1);
  if (!fit) return;
  CHECK_NEAR(fit->modes[0].natural_frequency_hz, 930, 1e-3);
  CHECK_NEAR(fit->modes[0].damping_ratio, 0.03, 1e-6);
}

void refusals() {
  const auto says = [](const Measured& m, const DynamometerFitOptions& o,
                       const std::string& words) {
    const auto fit = fit_dynamometer_modes(m.hz, m.value, o);
    CHECK(!fit.has_value() && fit.error().sentence.find(words) != std::string::npos);
  };
  const Measured m = measured({{930, 0.03, 0.9}}, 1, 0.02, 5);
  says(m, {0, 20, 60}, "fewer than 20 lines");
  says(m, {9, 0, 1e9}, "8 modes at most");
  says(measured({}, 1, 0.02, 6), {}, "shows no mode");
  Measured holes = m;
  for (std::size_t i = 0; i < holes.value.size(); i += 3) holes.value[i] = {std::nan(""), 0};
  CHECK(fit_dynamometer_modes(holes.hz, holes.value).has_value());
}

}  // namespace

int main() {
  found_again();
  errors_as_stated();
  behind_a_window();
  refusals();
  return check::done();
}
