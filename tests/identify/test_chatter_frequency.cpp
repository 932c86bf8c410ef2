// The line of chatter: known combs among harmonics, aliases and noise.
#include <cmath>
#include <random>
#include <vector>

#include "check.hpp"
#include "servosense/core/units.hpp"
#include "servosense/identify/chatter_frequency.hpp"

using namespace servosense;

namespace {

struct Signal {
  std::vector<double> torque_Nm, angle_rad;
};

/// Harmonics of the teeth up to 40 and of the rotation up to 10; chatter as lines of `comb`, [Nm],
/// one tooth frequency apart, the middle one at `hz`.
Signal cut(std::uint64_t seed, double rpm, unsigned teeth, double hz, std::vector<double> comb,
           double noise, std::size_t samples = 3000) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> gauss(0, 1);
  std::uniform_real_distribution<double> any(0, kTwoPi);
  std::vector<double> tooth(41), turn(11), tooth_at(41), turn_at(11), line_at(comb.size());
  for (auto* phases : {&tooth_at, &turn_at, &line_at})
    for (double& phase : *phases) phase = any(random);
  for (std::size_t h = 1; h <= 40; ++h) tooth[h] = 2 / std::sqrt(static_cast<double>(h));
  for (std::size_t h = 1; h <= 10; ++h) turn[h] = 0.3;
  Signal s;
  const double middle = (static_cast<double>(comb.size()) - 1) / 2;
  for (std::size_t i = 0; i < samples; ++i) {
    const double t = static_cast<double>(i) * 125e-6, angle = rad_s_from_rpm(rpm) * t;
    double y = 5 + noise * gauss(random);
    for (std::size_t h = 1; h <= 40; ++h)
      y += tooth[h] * std::cos(static_cast<double>(h * teeth) * angle + tooth_at[h]);
    for (std::size_t h = 1; h <= 10; ++h)
      y += turn[h] * std::cos(static_cast<double>(h) * angle + turn_at[h]);
    for (std::size_t k = 0; k < comb.size(); ++k)
      y += comb[k] * std::cos(kTwoPi * hz * t + (static_cast<double>(k) - middle) * teeth * angle +
                              line_at[k]);
    s.torque_Nm.push_back(y);
    s.angle_rad.push_back(std::fmod(angle, kTwoPi));
  }
  return s;
}

ChatterLine line_of(const Signal& s, unsigned teeth, std::vector<double> natural_hz = {}) {
  ChatterLineConfig c;
  c.teeth = teeth;
  c.natural_frequencies_hz = std::move(natural_hz);
  return chatter_line(s.torque_Nm, s.angle_rad, {}, c);
}

// Tooth harmonics ten times as strong as the chatter, four of them above half the sample rate: the
// chatter is told, never a harmonic.
void chatter_among_harmonics() {
  std::size_t told = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Signal s = cut(seed, 2800, 4, 835, {0.05, 0.2, 0.08}, 0.05);
    const ChatterLine line = line_of(s, 4);
    if (line.verdict != ChatterLineVerdict::told) continue;
    ++told;
    // A fifth of a resolution of 2.7 Hz.
    CHECK_NEAR(line.frequency_hz, 835, 0.6);
    CHECK_NEAR(line.spindle_speed_rpm, 2800, 0.01);
  }
  CHECK(told == 20);
}

// Harmonics and noise alone. One stretch in 500 is allowed by the factor: of 200 three are past
// 99 %.
void nothing_there() {
  std::size_t told = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed)
    told += line_of(cut(seed, 2800, 4, 0, {}, 0.05), 4).verdict == ChatterLineVerdict::told;
  CHECK(told <= 3);
  check::figure("of 200 stretches without chatter, told", static_cast<double>(told));
}

// Two teeth: two lines are within reach, a natural frequency decides.
void two_teeth() {
  const Signal s = cut(3, 5100, 2, 317, {0.1, 0.8, 0.8, 0.1}, 0.02);
  const ChatterLine open = line_of(s, 2);
  CHECK(open.verdict == ChatterLineVerdict::undecided && open.candidates_hz.size() == 2);
  const ChatterLine known = line_of(s, 2, {315 - 85});
  CHECK(known.verdict == ChatterLineVerdict::told);
  CHECK_NEAR(known.frequency_hz, 317 - 85, 0.6);
}

void bad_input() {
  Signal s = cut(5, 2800, 4, 835, {0.2}, 0.05, 1000);
  CHECK(line_of({}, 4).verdict == ChatterLineVerdict::silent);
  CHECK(line_of(s, 4).verdict == ChatterLineVerdict::silent);  // six revolutions
  s = cut(5, 2800, 4, 835, {0.2}, 0.05);
  s.torque_Nm[3] = std::nan("");
  CHECK(line_of(s, 4).verdict == ChatterLineVerdict::silent);
}

// A line that is known, and nothing else: at 2800 rpm with four teeth lines lie 186.7 Hz apart, and
// a natural frequency decides, where it is one alone.
void of_a_line() {
  const auto at = [](double hz, std::vector<double> natural_hz, unsigned teeth = 4) {
    ChatterLineConfig c;
    c.teeth = teeth;
    c.natural_frequencies_hz = std::move(natural_hz);
    return chatter_line_at(hz, 0.5, 2800, c);
  };
  const double tooth_hz = 2800.0 / 60 * 4;
  for (const double line : {835 - tooth_hz, 835.0, 835 + tooth_hz, 835 - 6 * tooth_hz}) {
    const ChatterLine told = at(std::abs(line), {820});
    CHECK(told.verdict == ChatterLineVerdict::told && told.candidates_hz.size() == 1);
    CHECK_NEAR(told.frequency_hz, 835, 1e-9);
    CHECK(told.spindle_speed_rpm == 2800 && told.standard_error_hz == 0.5);
  }
  for (const ChatterLine& line :
       {at(835, {}), at(835, {820}, 0), at(835, {815, 632}), at(835, {930})}) {
    CHECK(line.verdict == ChatterLineVerdict::undecided && line.line_hz == 835);
    CHECK(line.frequency_hz == 0 && line.candidates_hz.empty());
  }
}

}  // namespace

int main() {
  of_a_line();
  chatter_among_harmonics();
  nothing_there();
  two_teeth();
  bad_input();
  return check::done();
}
